//! Refuses to build against a RustDDS that lacks the patches of this checkout.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const PATCHES: &str = "../../patches/rustdds-0.15.1";
const APPLIED: &str = "../../.tools/rustdds/patches";

fn main() {
    println!("cargo::rerun-if-changed={PATCHES}");
    println!("cargo::rerun-if-changed={APPLIED}");
    if read(PATCHES) != read(APPLIED) {
        println!("cargo::error=RustDDS has not been patched with patches/rustdds-0.15.1: run launch-scripts/setup");
    }
}

/// The files of a folder by name; empty where there is no such folder.
fn read(folder: &str) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(Path::new(folder)).into_iter().flatten().flatten();
    files
        .map(|file| (file.file_name().to_string_lossy().into_owned(), fs::read(file.path()).unwrap_or_default()))
        .collect()
}
