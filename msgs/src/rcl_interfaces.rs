//! Parameters and log messages.

use crate::builtin_interfaces::Time;

messages! { "rcl_interfaces";
    /// One line of `/rosout`.
    Log {
        /// When.
        stamp: Time,
        /// 10 debug, 20 info, 30 warn, 40 error, 50 fatal.
        level: u8,
        /// The logger's name.
        name: String,
        /// The text.
        msg: String,
        /// Source file.
        file: String,
        /// Function.
        function: String,
        /// Line in the source file.
        line: u32,
    }
    /// A value of any of the types that a parameter can have; `type` says which field counts.
    ParameterValue {
        /// 0 not set, 1 bool, 2 integer, 3 double, 4 string, 5 byte array, 6 bool array, 7 integer array, 8 double
        /// array, 9 string array.
        r#type: u8,
        /// Type 1.
        bool_value: bool,
        /// Type 2.
        integer_value: i64,
        /// Type 3.
        double_value: f64,
        /// Type 4.
        string_value: String,
        /// Type 5.
        byte_array_value: Vec<u8> as "byte[]",
        /// Type 6.
        bool_array_value: Vec<bool>,
        /// Type 7.
        integer_array_value: Vec<i64>,
        /// Type 8.
        double_array_value: Vec<f64>,
        /// Type 9.
        string_array_value: Vec<String>,
    }
    /// A named value.
    Parameter {
        /// Its name.
        name: String,
        /// Its value.
        value: ParameterValue,
    }
    /// The range of a double.
    #[derive(Copy)]
    FloatingPointRange {
        /// Least value.
        from_value: f64,
        /// Greatest value.
        to_value: f64,
        /// Step from `from_value`; 0: any value between.
        step: f64,
    }
    /// The range of an integer.
    #[derive(Copy)]
    IntegerRange {
        /// Least value.
        from_value: i64,
        /// Greatest value.
        to_value: i64,
        /// Step from `from_value`; 0: any value between.
        step: u64,
    }
    /// What a parameter is.
    ParameterDescriptor {
        /// Its name.
        name: String,
        /// As in [`ParameterValue`].
        r#type: u8,
        /// For people.
        description: String,
        /// For people: constraints beyond the range.
        additional_constraints: String,
        /// Cannot be changed at run time.
        read_only: bool,
        /// May change its type.
        dynamic_typing: bool,
        /// At most one.
        floating_point_range: crate::Optional<FloatingPointRange>,
        /// At most one.
        integer_range: crate::Optional<IntegerRange>,
    }
    /// Whether it was set.
    SetParametersResult {
        /// Set.
        successful: bool,
        /// Why not.
        reason: String,
    }
    /// What `list_parameters` found.
    ListParametersResult {
        /// Full names.
        names: Vec<String>,
        /// Prefixes of those names.
        prefixes: Vec<String>,
    }
    /// Parameters of a node changed.
    ParameterEvent {
        /// When.
        stamp: Time,
        /// The node's full name.
        node: String,
        /// Declared.
        new_parameters: Vec<Parameter>,
        /// Changed.
        changed_parameters: Vec<Parameter>,
        /// Gone.
        deleted_parameters: Vec<Parameter>,
    }
    /// Which parameters to list.
    ListParametersRequest {
        /// Only below these; empty: all.
        prefixes: Vec<String>,
        /// How many levels below; 0: all.
        depth: u64,
    }
    /// The list.
    ListParametersResponse {
        /// What was found.
        result: ListParametersResult,
    }
    /// Which parameters to read.
    GetParametersRequest {
        /// Names.
        names: Vec<String>,
    }
    /// In the order of the names.
    GetParametersResponse {
        /// Type 0 for an unknown name.
        values: Vec<ParameterValue>,
    }
    /// Which parameters' types.
    GetParameterTypesRequest {
        /// Names.
        names: Vec<String>,
    }
    /// In the order of the names.
    GetParameterTypesResponse {
        /// 0 for an unknown name.
        types: Vec<u8>,
    }
    /// What to set, one after the other.
    SetParametersRequest {
        /// Names and values.
        parameters: Vec<Parameter>,
    }
    /// One for each.
    SetParametersResponse {
        /// In the order of the request.
        results: Vec<SetParametersResult>,
    }
    /// What to set, all or nothing.
    SetParametersAtomicallyRequest {
        /// Names and values.
        parameters: Vec<Parameter>,
    }
    /// One for all.
    SetParametersAtomicallyResponse {
        /// Whether all were set.
        result: SetParametersResult,
    }
    /// Which parameters to describe.
    DescribeParametersRequest {
        /// Names.
        names: Vec<String>,
    }
    /// In the order of the names.
    DescribeParametersResponse {
        /// Type 0 for an unknown name.
        descriptors: Vec<ParameterDescriptor>,
    }
}

service! {
    /// Lists parameters.
    "rcl_interfaces" ListParameters: ListParametersRequest -> ListParametersResponse
}
service! {
    /// Reads parameters.
    "rcl_interfaces" GetParameters: GetParametersRequest -> GetParametersResponse
}
service! {
    /// Reads parameters' types.
    "rcl_interfaces" GetParameterTypes: GetParameterTypesRequest -> GetParameterTypesResponse
}
service! {
    /// Sets parameters one by one.
    "rcl_interfaces" SetParameters: SetParametersRequest -> SetParametersResponse, refused by |request, reason| {
        let refused = SetParametersResult { successful: false, reason: reason.to_owned() };
        SetParametersResponse { results: vec![refused; request.parameters.len()] }
    }
}
service! {
    /// Sets parameters, all or nothing.
    "rcl_interfaces" SetParametersAtomically: SetParametersAtomicallyRequest -> SetParametersAtomicallyResponse, refused by |_, reason| {
        SetParametersAtomicallyResponse { result: SetParametersResult { successful: false, reason: reason.to_owned() } }
    }
}
service! {
    /// Describes parameters.
    "rcl_interfaces" DescribeParameters: DescribeParametersRequest -> DescribeParametersResponse
}
