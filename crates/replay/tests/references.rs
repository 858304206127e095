//! Commands of earlier programs, computed again to the bit: `tests/bag/make_references` says what they are of.

use std::path::Path;

use replay::verify;

/// Name and cycles.
const REFERENCES: [(&str, u64); 4] = [("gait1", 125), ("amble", 100), ("drives", 100), ("faults", 230)];

#[test]
fn commands_recorded_before_the_controller_was_split_come_out_the_same_to_the_bit() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/bag/references"));
    for (name, cycles) in REFERENCES {
        let verification = verify(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((verification.cycles, verification.different), (cycles, 0), "{name}: {:?}", verification.first);
    }
}
