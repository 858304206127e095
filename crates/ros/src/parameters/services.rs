//! The parameter services.

use tandem_msgs::rcl_interfaces as wire;
use tandem_msgs::text::{NAME_CHARS, SENTENCE_CHARS, printable};

use super::store::Store;
use super::value::ParameterValue;

/// Most parameters that one request sets, reads or describes; what is beyond is refused, or left out where nothing can
/// be reported.
pub(super) const MAX_PARAMETERS: usize = 256;

impl Store {
    fn set_from_wire(&self, parameters: &[wire::Parameter]) -> wire::SetParametersResult {
        let outcome = too_many(parameters.len())
            .and_then(|()| {
                parameters
                    .iter()
                    .map(|parameter| {
                        ParameterValue::from_wire(&parameter.value)
                            .map(|value| (parameter.name.clone(), value))
                            .map_err(|reason| {
                                format!("parameter {:?}: {reason}", printable(&parameter.name, NAME_CHARS))
                            })
                    })
                    .collect::<Result<Vec<_>, _>>()
            })
            .and_then(|parameters| self.set(&parameters));
        // The reason repeats names and values of the request.
        let reason = outcome.as_ref().err().map(|reason| printable(reason, SENTENCE_CHARS).into_owned());
        wire::SetParametersResult { successful: outcome.is_ok(), reason: reason.unwrap_or_default() }
    }

    // The six services. Of longer lists than they take they leave out the rest: no field of theirs says so.

    pub(crate) fn list_parameters(&self, request: &wire::ListParametersRequest) -> wire::ListParametersResponse {
        let declared = self.declared();
        let levels = |name: &str| name.matches('.').count() as u64;
        let wanted = |name: &&String| {
            if request.prefixes.is_empty() {
                return request.depth == 0 || levels(name) < request.depth;
            }
            request.prefixes.iter().take(MAX_PARAMETERS).any(|prefix| {
                name.as_str() == prefix
                    || name.strip_prefix(prefix.as_str()).is_some_and(|rest| {
                        rest.starts_with('.') && (request.depth == 0 || levels(&rest[1..]) < request.depth)
                    })
            })
        };
        let names: Vec<String> = declared.keys().filter(wanted).cloned().collect();
        let mut prefixes: Vec<String> =
            names.iter().filter_map(|name| name.rsplit_once('.').map(|(prefix, _)| prefix.to_string())).collect();
        prefixes.dedup();
        wire::ListParametersResponse { result: wire::ListParametersResult { names, prefixes } }
    }

    pub(crate) fn get_parameters(&self, request: &wire::GetParametersRequest) -> wire::GetParametersResponse {
        let declared = self.declared();
        wire::GetParametersResponse {
            values: request
                .names
                .iter()
                .take(MAX_PARAMETERS)
                .map(|name| declared.get(name).map(|entry| entry.value.to_wire()).unwrap_or_default())
                .collect(),
        }
    }

    pub(crate) fn get_parameter_types(
        &self,
        request: &wire::GetParameterTypesRequest,
    ) -> wire::GetParameterTypesResponse {
        let declared = self.declared();
        wire::GetParameterTypesResponse {
            types: request
                .names
                .iter()
                .take(MAX_PARAMETERS)
                .map(|name| declared.get(name).map_or(0, |entry| entry.value.type_number()))
                .collect(),
        }
    }

    pub(crate) fn describe_parameters(
        &self,
        request: &wire::DescribeParametersRequest,
    ) -> wire::DescribeParametersResponse {
        let declared = self.declared();
        wire::DescribeParametersResponse {
            descriptors: request
                .names
                .iter()
                .take(MAX_PARAMETERS)
                .map(|name| match declared.get(name) {
                    Some(entry) => entry.descriptor.clone(),
                    None => wire::ParameterDescriptor {
                        name: printable(name, NAME_CHARS).into_owned(),
                        ..Default::default()
                    },
                })
                .collect(),
        }
    }

    pub(crate) fn set_parameters(&self, request: &wire::SetParametersRequest) -> wire::SetParametersResponse {
        if let Err(reason) = too_many(request.parameters.len()) {
            // None is set; of the refusals there are no more than of parameters that would have been.
            let refused = wire::SetParametersResult { successful: false, reason };
            return wire::SetParametersResponse { results: vec![refused; MAX_PARAMETERS] };
        }
        wire::SetParametersResponse {
            results: request
                .parameters
                .iter()
                .map(|parameter| self.set_from_wire(std::slice::from_ref(parameter)))
                .collect(),
        }
    }

    pub(crate) fn set_parameters_atomically(
        &self,
        request: &wire::SetParametersAtomicallyRequest,
    ) -> wire::SetParametersAtomicallyResponse {
        wire::SetParametersAtomicallyResponse { result: self.set_from_wire(&request.parameters) }
    }
}

fn too_many(parameters: usize) -> Result<(), String> {
    if parameters > MAX_PARAMETERS {
        return Err(format!("{parameters} parameters in one request, expected at most {MAX_PARAMETERS}"));
    }
    Ok(())
}
