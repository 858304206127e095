//! DDS Security: what the environment and the command line ask for, and the enclave's files in the keystore.
//!
//! One place for every program: [`Arguments::parse`](crate::Arguments::parse) asks it, with the feature `security` and
//! without.

use std::path::{Path, PathBuf};

use ros2_client::dds::rustdds::DomainParticipantBuilder;
#[cfg(feature = "security")]
use ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles;

use crate::RosError;
use crate::names::full_namespace;

/// What an enclave's folder holds, as sros2 makes it.
const FILES: [&str; 6] =
    ["identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"];

/// How a node's messages are protected.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum Security {
    /// Not at all: anybody on the network can read and command.
    #[default]
    Off,
    /// Not at all, although it was asked for: the strategy is Permissive, and the reason why there is nothing.
    Unprotected(String),
    /// With the files in this folder.
    Enclave(PathBuf),
}

impl Security {
    /// From `ROS_SECURITY_ENABLE`, `_STRATEGY`, `_KEYSTORE` and `_ENCLAVE_OVERRIDE`, and the enclave's name from the
    /// command line.
    ///
    /// # Errors
    /// A misprint; what is asked for and not there. Nobody who asks for security is run without it unless they say that
    /// they allow that.
    pub(crate) fn find(environment: &impl Fn(&str) -> Option<String>, enclave: Option<&str>) -> Result<Self, RosError> {
        let Some(strategy) = demand(environment)? else { return Ok(Security::Off) };
        if !cfg!(feature = "security") {
            return Err(built_without("ROS_SECURITY_ENABLE", "true"));
        }
        let named = environment("ROS_SECURITY_ENCLAVE_OVERRIDE").filter(|name| !name.is_empty());
        let name = named.as_deref().or(enclave).unwrap_or("/");
        check_enclave(name).map_err(|reason| RosError::Security { enclave: name.to_string(), reason })?;
        match (files(environment, name), strategy) {
            (Ok(folder), _) => Ok(Security::Enclave(folder)),
            (Err(reason), Strategy::Permissive) => Ok(Security::Unprotected(reason)),
            (Err(reason), Strategy::Enforce) => Err(RosError::Security { enclave: name.to_string(), reason }),
        }
    }

    /// The participant with these credentials.
    ///
    /// # Errors
    /// There are credentials and no code to use them.
    pub(crate) fn protect(&self, builder: DomainParticipantBuilder) -> Result<DomainParticipantBuilder, RosError> {
        match self {
            Security::Off => Ok(builder),
            Security::Unprotected(reason) => {
                tracing::warn!("DDS Security is not there: anybody on the network can command this node ({reason})");
                Ok(builder)
            }
            #[cfg(feature = "security")]
            Security::Enclave(folder) => {
                tracing::info!("DDS Security: {}", folder.display());
                let files = DomainParticipantSecurityConfigFiles::with_ros_default_names(folder, String::new());
                Ok(builder.builtin_security(files))
            }
            #[cfg(not(feature = "security"))]
            Security::Enclave(_) => Err(built_without("ROS_SECURITY_ENABLE", "true")),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Strategy {
    Enforce,
    Permissive,
}

/// None where nobody asks for security. Only an explicit `ROS_SECURITY_ENABLE=false` switches a demand for enforcement
/// off. Unlike in ROS 2 the strategy is Enforce where it is not given: the default is the safe one.
fn demand(environment: &impl Fn(&str) -> Option<String>) -> Result<Option<Strategy>, RosError> {
    let value_of = |name| environment(name).filter(|value| !value.is_empty());
    let refused = |name, value: &str, reason: &str| {
        Err(RosError::Environment { name, value: value.to_string(), reason: reason.to_string() })
    };
    let strategy = value_of("ROS_SECURITY_STRATEGY");
    let wanted = match strategy.as_deref() {
        None | Some("Enforce") => Strategy::Enforce,
        Some("Permissive") => Strategy::Permissive,
        Some(other) => return refused("ROS_SECURITY_STRATEGY", other, "expected Enforce or Permissive"),
    };
    match value_of("ROS_SECURITY_ENABLE").as_deref() {
        Some("true") => Ok(Some(wanted)),
        Some("false") => Ok(None),
        Some(other) => refused("ROS_SECURITY_ENABLE", other, "expected true or false"),
        None if strategy.as_deref() != Some("Enforce") => Ok(None),
        None if cfg!(feature = "security") => refused(
            "ROS_SECURITY_STRATEGY",
            "Enforce",
            "DDS Security is demanded and not switched on: set ROS_SECURITY_ENABLE to true, or to false to run unprotected",
        ),
        None => Err(built_without("ROS_SECURITY_STRATEGY", "Enforce")),
    }
}

/// Whoever asks for security must not get a robot that anybody may command.
fn built_without(name: &'static str, value: &str) -> RosError {
    let reason = "this program is built without DDS Security and would run unprotected; build it with it \
                  (cargo build --release --workspace --features security, docs/security.md), \
                  or set ROS_SECURITY_ENABLE=false to run it so";
    RosError::Environment { name, value: value.to_string(), reason: reason.to_string() }
}

/// An enclave's name is a full namespace. It becomes a path, which must not lead out of the keystore.
fn check_enclave(name: &str) -> Result<(), String> {
    if !name.starts_with('/') {
        return Err("its name must begin with a slash".to_string());
    }
    full_namespace(name).map(|_| ()).map_err(|error| error.to_string())
}

/// The enclave's folder, in which everything is; or what is not.
fn files(environment: &impl Fn(&str) -> Option<String>, enclave: &str) -> Result<PathBuf, String> {
    let keystore = environment("ROS_SECURITY_KEYSTORE")
        .filter(|path| !path.is_empty())
        .ok_or("ROS_SECURITY_KEYSTORE is not set: expected the keystore's folder")?;
    let keystore = Path::new(&keystore);
    if !keystore.is_dir() {
        return Err(format!("the keystore {} is not a folder (ROS_SECURITY_KEYSTORE)", keystore.display()));
    }
    // "/" is the folder of all enclaves itself.
    let folder = keystore.join("enclaves").join(&enclave[1..]);
    if !folder.is_dir() {
        let make = format!("`ros2 security create_enclave {} {enclave}` makes it", keystore.display());
        return Err(format!("there is no folder {}: {make}", folder.display()));
    }
    for name in FILES {
        let path = folder.join(name);
        std::fs::File::open(&path).map_err(|error| format!("{} cannot be read: {error}", path.display()))?;
    }
    // Who has revoked a certificate counts on it.
    let revoked = folder.join("crl.pem");
    if revoked.exists() {
        return Err(format!("{} is there, and lists of revoked certificates are not supported", revoked.display()));
    }
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(variables: &[(&str, &str)], enclave: Option<&str>) -> Result<Security, String> {
        let environment =
            |asked: &str| variables.iter().find(|(name, _)| *name == asked).map(|(_, value)| (*value).to_string());
        Security::find(&environment, enclave).map_err(|error| error.to_string())
    }

    #[test]
    fn who_does_not_ask_gets_none() {
        for variables in [
            &[][..],
            &[("ROS_SECURITY_ENABLE", "false"), ("ROS_SECURITY_STRATEGY", "Enforce")],
            &[("ROS_SECURITY_ENABLE", ""), ("ROS_SECURITY_STRATEGY", "Permissive")],
            &[("ROS_SECURITY_KEYSTORE", "/nowhere"), ("ROS_SECURITY_ENCLAVE_OVERRIDE", "nowhere")],
        ] {
            assert_eq!(find(variables, Some("/robot")), Ok(Security::Off), "{variables:?}");
        }
    }

    #[test]
    fn a_misprint_is_no_false() {
        for value in ["1", "True", "yes", "\u{fffd}"] {
            assert!(find(&[("ROS_SECURITY_ENABLE", value)], None).unwrap_err().contains("expected true or false"));
        }
        for enable in ["true", "false", ""] {
            let variables = [("ROS_SECURITY_ENABLE", enable), ("ROS_SECURITY_STRATEGY", "enforce")];
            assert!(find(&variables, None).unwrap_err().contains("Enforce or Permissive"), "{enable}");
        }
    }

    #[cfg(not(feature = "security"))]
    #[test]
    fn who_asks_for_security_is_refused_and_never_run_unprotected() {
        let message = "built without DDS Security and would run unprotected";
        for strategy in ["", "Enforce", "Permissive"] {
            let refusal =
                find(&[("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", strategy)], None).unwrap_err();
            assert!(refusal.contains("ROS_SECURITY_ENABLE=true") && refusal.contains(message), "{refusal}");
            assert!(refusal.contains("--features security"), "{refusal}");
        }
        assert!(find(&[("ROS_SECURITY_STRATEGY", "Enforce")], None).unwrap_err().contains(message));
    }

    #[cfg(feature = "security")]
    mod built_with {
        use super::*;

        /// A folder of its own, gone in the end.
        struct Keystore(PathBuf);

        impl Keystore {
            fn new(name: &str) -> Self {
                let folder = std::env::temp_dir().join(format!("tandem-security-{}-{name}", std::process::id()));
                std::fs::create_dir_all(folder.join("enclaves/robot/arm")).unwrap();
                for name in FILES {
                    std::fs::write(folder.join("enclaves/robot/arm").join(name), "x").unwrap();
                }
                Keystore(folder)
            }

            fn find(&self, strategy: &str, enclave: Option<&str>) -> Result<Security, String> {
                let keystore = self.0.to_str().unwrap();
                let variables = [
                    ("ROS_SECURITY_ENABLE", "true"),
                    ("ROS_SECURITY_STRATEGY", strategy),
                    ("ROS_SECURITY_KEYSTORE", keystore),
                ];
                super::find(&variables, enclave)
            }
        }

        impl Drop for Keystore {
            fn drop(&mut self) {
                std::fs::remove_dir_all(&self.0).unwrap();
            }
        }

        #[test]
        fn the_enclave_is_a_folder_of_the_keystore() {
            let keystore = Keystore::new("found");
            let folder = keystore.0.join("enclaves/robot/arm");
            assert_eq!(keystore.find("Enforce", Some("/robot/arm")), Ok(Security::Enclave(folder.clone())));
            assert_eq!(keystore.find("Permissive", Some("/robot/arm")), Ok(Security::Enclave(folder.clone())));
            let text = keystore.0.to_str().unwrap();
            let mut variables = vec![
                ("ROS_SECURITY_ENABLE", "true"),
                ("ROS_SECURITY_KEYSTORE", text),
                ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/robot/arm"),
            ];
            assert_eq!(super::find(&variables, Some("/other")), Ok(Security::Enclave(folder.clone())));
            // Empty is not set.
            variables[2].1 = "";
            assert_eq!(super::find(&variables, Some("/robot/arm")), Ok(Security::Enclave(folder)));
        }

        #[test]
        fn what_is_missing_is_named_and_enforced_by_default() {
            let keystore = Keystore::new("missing");
            let folder = keystore.0.join("enclaves/robot/arm");
            for name in FILES {
                std::fs::remove_file(folder.join(name)).unwrap();
                for strategy in ["Enforce", ""] {
                    let refusal = keystore.find(strategy, Some("/robot/arm")).unwrap_err();
                    assert!(refusal.contains(&format!("/enclaves/robot/arm/{name} cannot be read")), "{refusal}");
                }
                let lenient = keystore.find("Permissive", Some("/robot/arm")).unwrap();
                assert!(matches!(lenient, Security::Unprotected(reason) if reason.contains(name)));
                std::fs::write(folder.join(name), "x").unwrap();
            }
            assert!(keystore.find("Enforce", Some("/robot/leg")).unwrap_err().contains("enclaves/robot/leg"));
            assert!(keystore.find("Enforce", None).unwrap_err().contains("enclaves/identity_ca.cert.pem"));
            let on = ("ROS_SECURITY_ENABLE", "true");
            assert!(super::find(&[on], None).unwrap_err().contains("ROS_SECURITY_KEYSTORE is not set"));
            assert!(super::find(&[on, ("ROS_SECURITY_KEYSTORE", "/nowhere")], None).unwrap_err().contains("/nowhere"));
            assert!(
                super::find(&[("ROS_SECURITY_STRATEGY", "Enforce")], None).unwrap_err().contains("not switched on")
            );
        }

        #[test]
        fn an_enclave_does_not_lead_out_of_the_keystore() {
            let keystore = Keystore::new("names");
            for name in ["robot", "", "/..", "/robot/../robot/arm", "/robot//arm", "/robot/", "/ro bot"] {
                for strategy in ["Enforce", "Permissive"] {
                    assert!(keystore.find(strategy, Some(name)).is_err(), "{name:?}");
                }
            }
        }

        #[test]
        fn revoked_certificates_are_not_passed_over() {
            let keystore = Keystore::new("revoked");
            std::fs::write(keystore.0.join("enclaves/robot/arm/crl.pem"), "x").unwrap();
            assert!(keystore.find("Enforce", Some("/robot/arm")).unwrap_err().contains("crl.pem"));
        }
    }
}
