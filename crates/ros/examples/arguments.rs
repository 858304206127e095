//! What a node makes of its command line, as JSON, for `tests/ros2/test_arguments.py`: names after remapping, and
//! parameters.

use ros::{Arguments, Node, ParameterType, Qos};
use tandem_msgs::std_msgs::String as Text;
use tandem_msgs::std_srvs::Trigger;

fn value<T: ParameterType + std::fmt::Debug>(node: &Node, name: &str, default: T) -> Result<String, ros::RosError> {
    Ok(format!("{:?}: {:?}", name, node.parameter(name, default).declare()?.get()))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (arguments, rest) = Arguments::from_process()?;
    let node = Node::start("walker", &arguments)?;
    let topics = ["chatter", "/chatter", "~/state", "a/b"]
        .map(|name| node.publisher::<Text>(name, Qos::reliable(1)).map(|p| format!("{:?}: {:?}", name, p.topic())));
    let services = ["add", "~/get", "chatter"]
        .map(|name| node.client::<Trigger>(name).map(|client| format!("{:?}: {:?}", name, client.service())));
    let parameters = [
        value(&node, "rate", 1.0)?,
        value(&node, "count", 1_i64)?,
        value(&node, "flag", false)?,
        value(&node, "text", "text".to_string())?,
        value(&node, "group.deep.list", vec![0.5])?,
        value(&node, "numbers", vec![1_i64])?,
        value(&node, "words", vec!["a".to_string()])?,
        value(&node, "flags", vec![true])?,
    ];
    println!(
        "{{\"name\": {:?}, \"topics\": {{{}}}, \"services\": {{{}}}, \"parameters\": {{{}}}, \"rest\": {:?}}}",
        node.full_name(),
        topics.into_iter().collect::<Result<Vec<_>, _>>()?.join(", "),
        services.into_iter().collect::<Result<Vec<_>, _>>()?.join(", "),
        parameters.join(", "),
        &rest[1..]
    );
    Ok(())
}
