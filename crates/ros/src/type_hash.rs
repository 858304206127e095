//! The hashes of their types that endpoints announce, as ROS 2's middleware does (REP 2016).

use ros2_client::dds::rustdds::discovery::user_data::announce_for_type;
use tandem_msgs::rcl_interfaces::ParameterEvent;
use tandem_msgs::{Action, Message, Service, TypeHash};

/// Of the graph's own topic, which the middleware creates for every node: `rmw_dds_common/msg/ParticipantEntitiesInfo`
/// with identifiers of 16 bytes.
const GRAPH: (&str, &str) = (
    "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
    "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e",
);

/// Of what the middleware itself creates for a node: before the node is made.
pub(crate) fn announce_graph() {
    announce(GRAPH.0, GRAPH.1);
    announce_message::<ParameterEvent>();
}

/// The same for a topic, before its endpoint is created; likewise the others.
pub(crate) fn announce_message<M: Message>() {
    announce_all([TypeHash::of_message::<M>()]);
}

pub(crate) fn announce_service<S: Service>() {
    announce_all(TypeHash::of_service::<S>());
}

pub(crate) fn announce_action<A: Action>() {
    announce_all(TypeHash::of_action::<A>());
}

fn announce_all(types: impl IntoIterator<Item = TypeHash>) {
    types.into_iter().for_each(|described| announce(&described.dds_name(), &described.hash));
}

fn announce(dds_name: &str, hash: &str) {
    announce_for_type(dds_name, format!("typehash={hash};").as_bytes());
}
