//! Makes the program find MuJoCo's shared library without any environment variable.

fn main() {
    // Inside the clone: target/<profile>/program and target/<profile>/deps/test.
    // Installed: lib/<package>/program beside lib/libmujoco.so.
    for folder in ["$ORIGIN/../../.tools/mujoco/lib", "$ORIGIN/../../../.tools/mujoco/lib", "$ORIGIN/.."] {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
    }
    // The target folder may be elsewhere (CARGO_TARGET_DIR): the path used for linking, last.
    if let Ok(folder) = std::env::var("MUJOCO_DYNAMIC_LINK_DIR") {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
    }
    println!("cargo::rerun-if-env-changed=MUJOCO_DYNAMIC_LINK_DIR");
    println!("cargo::rerun-if-changed=build.rs");
}
