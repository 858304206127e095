//! One definition gives the Rust type and the table of its fields.

/// Defines messages of one package. A field may name its ROS type where the Rust type does not determine it
/// (`level: u8 as "byte"`), and a structure without members carries the byte that ROS 2 puts on the wire for it.
macro_rules! messages {
    ($package:literal; $(
        $(#[$meta:meta])*
        $name:ident { $( $(#[$field_meta:meta])* $field:ident : $type:ty $(as $ros:literal)? ),* $(,)? }
    )*) => { $(
        $(#[$meta])*
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
        pub struct $name { $( $(#[$field_meta])* pub $field: $type, )* }

        impl $crate::FieldType for $name {
            fn type_name() -> ::std::string::String {
                format!("{}/{}", $package, stringify!($name))
            }
            fn add_definitions(definitions: &mut Vec<(::std::string::String, ::std::string::String)>) {
                let name = <Self as $crate::FieldType>::type_name();
                if definitions.iter().any(|(known, _)| *known == name) {
                    return;
                }
                let text = <Self as $crate::Message>::fields()
                    .iter()
                    .filter(|field| field.name != "structure_needs_at_least_one_member")
                    .map(|field| format!("{} {}\n", field.type_name, field.name))
                    .collect();
                definitions.push((name, text));
                $( <$type as $crate::FieldType>::add_definitions(definitions); )*
            }
        }

        impl $crate::Message for $name {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($name);
            fn fields() -> Vec<$crate::Field> {
                vec![ $( $crate::Field {
                    name: stringify!($field).trim_start_matches("r#"),
                    type_name: messages!(@type $type $(, $ros)?),
                } ),* ]
            }
        }
    )* };
    (@type $type:ty) => { <$type as $crate::FieldType>::type_name() };
    (@type $type:ty, $ros:literal) => { $ros.to_string() };
}

/// Ties a request and a response together. `refused by message`: the response's `success` is false and that field says
/// why; or a function of the request and the reason.
macro_rules! service {
    ($(#[$meta:meta])* $package:literal $name:ident: $request:ident -> $response:ident) => {
        service! { @ $(#[$meta])* $package $name $request $response }
    };
    ($(#[$meta:meta])* $package:literal $name:ident: $request:ident -> $response:ident, refused by $message:ident) => {
        service! { @ $(#[$meta])* $package $name $request $response
            |_, reason| {
                // By default it did not succeed.
                let mut refusal = $response::default();
                refusal.$message.push_str(reason);
                refusal
            } }
    };
    ($(#[$meta:meta])* $package:literal $name:ident: $request:ident -> $response:ident, refused by |$($refuse:tt)*) => {
        service! { @ $(#[$meta])* $package $name $request $response |$($refuse)* }
    };
    (@ $(#[$meta:meta])* $package:literal $name:ident $request:ident $response:ident $($refuse:expr)?) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug)]
        pub enum $name {}

        impl $crate::Service for $name {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($name);
            type Request = $request;
            type Response = $response;
            $(
                fn refusal(request: &$request, reason: &str) -> Option<$response> {
                    let refuse: fn(&$request, &str) -> $response = $refuse;
                    Some(refuse(request, reason))
                }
            )?
        }
    };
}
