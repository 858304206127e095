//! Refuses to build where RustDDS's source is missing or lacks the patches of this checkout.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::Path;

const APPLIED: &str = "../../.tools/rustdds/patches";

fn main() {
    println!("cargo::rerun-if-changed=.");
    println!("cargo::rerun-if-changed={APPLIED}");
    if patches(".") != patches(APPLIED) {
        println!("cargo::error=RustDDS has not been patched with patches/rustdds-0.15.1: run launch-scripts/setup");
    }
}

/// The patches of a folder by name; empty where there is no such folder.
fn patches(folder: &str) -> BTreeMap<OsString, Vec<u8>> {
    let files = fs::read_dir(Path::new(folder)).into_iter().flatten().flatten();
    let patches = files.filter(|file| file.path().extension().is_some_and(|extension| extension == "patch"));
    patches.map(|file| (file.file_name(), fs::read(file.path()).unwrap_or_default())).collect()
}
