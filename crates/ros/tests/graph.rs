//! The bytes of `ros_discovery_info`, by which nodes find each other in the graph: Humble's name endpoints by 24 bytes,
//! those of Iron and later by 16 (`rmw_dds_common`). The features `humble` and `kilted` choose.

use byteorder::LittleEndian;
use ros2_client::entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo};
use ros2_client::{Gid, NodeName};

/// Bytes of an endpoint's name.
const NAME: usize = if cfg!(feature = "kilted") { 16 } else { 24 };

/// A DDS GUID, with zeros behind it where the name is longer.
fn name(guid: u8) -> Vec<u8> {
    let mut bytes = vec![guid; 16];
    bytes.resize(NAME, 0);
    bytes
}

/// A text: its length with the zero behind it, the text, and up to the next multiple of four.
fn text(text: &str, out: &mut Vec<u8>) {
    out.extend(u32::try_from(text.len() + 1).unwrap().to_le_bytes());
    out.extend(text.bytes().chain([0]));
    out.resize(out.len().next_multiple_of(4), 0);
}

#[test]
fn a_program_s_entry_has_the_layout_of_its_distribution() {
    let mut node = NodeEntitiesInfo::new(NodeName::new("/robot", "planner").unwrap());
    node.add_reader(Gid::from([2; 16]));
    node.add_writer(Gid::from([3; 16]));
    node.add_writer(Gid::from([4; 16]));
    let entry = ParticipantEntitiesInfo::new(Gid::from([1; 16]), vec![node]);
    let found = cdr_encoding::to_vec::<_, LittleEndian>(&entry).unwrap();

    let mut expected = name(1);
    expected.extend(1_u32.to_le_bytes());
    text("/robot", &mut expected);
    text("planner", &mut expected);
    for guids in [&[2][..], &[3, 4]] {
        expected.extend(u32::try_from(guids.len()).unwrap().to_le_bytes());
        guids.iter().for_each(|guid| expected.extend(name(*guid)));
    }
    assert_eq!(found, expected);
    let back: ParticipantEntitiesInfo = cdr_encoding::from_bytes::<_, LittleEndian>(&expected).unwrap().0;
    assert_eq!((back.gid(), back.nodes()), (entry.gid(), entry.nodes()));
}
