//! Services without arguments of their own.

messages! { "std_srvs";
    /// Nothing; ROS 2 sends one byte for it.
    #[derive(Copy)]
    TriggerRequest {
        /// Always 0.
        structure_needs_at_least_one_member: u8,
    }
    /// Whether it was done.
    TriggerResponse {
        /// Done.
        success: bool,
        /// For people: what was done, or why not.
        message: String,
    }
    /// Yes or no.
    #[derive(Copy)]
    SetBoolRequest {
        /// The value to set.
        data: bool,
    }
    /// Whether it was done.
    SetBoolResponse {
        /// Done.
        success: bool,
        /// For people: what was done, or why not.
        message: String,
    }
}

service! {
    /// Do what the service's name says.
    "std_srvs" Trigger: TriggerRequest -> TriggerResponse, refused by message
}
service! {
    /// Switch what the service's name says.
    "std_srvs" SetBool: SetBoolRequest -> SetBoolResponse, refused by message
}

impl TriggerResponse {
    /// It was done.
    pub fn done(message: impl Into<String>) -> Self {
        TriggerResponse { success: true, message: message.into() }
    }

    /// It was not done, and why.
    pub fn refused(message: impl Into<String>) -> Self {
        TriggerResponse { success: false, message: message.into() }
    }
}
