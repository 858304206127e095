//! The process's participant in its DDS domain.

use std::net::Ipv4Addr;

use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder};

use crate::RosError;
use crate::arguments::{Arguments, DiscoveryRange};

/// Participants of a machine and domain that are announced to each other on its loopback (RustDDS, patch 66).
const MAX_LOCAL_PARTICIPANTS: u16 = 32;

/// # Errors
/// When the middleware cannot start; `error` names the node.
pub(crate) fn start(arguments: &Arguments, error: &impl Fn(String) -> RosError) -> Result<DomainParticipant, RosError> {
    let mut builder = DomainParticipantBuilder::new(arguments.domain_id);
    if arguments.range == DiscoveryRange::Localhost {
        builder = builder.with_only_networks([Ipv4Addr::LOCALHOST]);
    }
    let participant = arguments.security.protect(builder)?.build().map_err(|reason| error(reason.to_string()))?;
    // The others do not look for a later one where loopback carries no multicast.
    let id = participant.participant_id();
    if arguments.range == DiscoveryRange::Localhost && id >= MAX_LOCAL_PARTICIPANTS {
        tracing::warn!(
            "this is participant {} of domain {} on this machine: only the first {MAX_LOCAL_PARTICIPANTS} are sure to find each \
             other; end some, or set another ROS_DOMAIN_ID",
            id + 1,
            arguments.domain_id
        );
    }
    Ok(participant)
}
