//! Managed nodes.

messages! { "lifecycle_msgs";
    /// A state.
    State {
        /// 1 unconfigured, 2 inactive, 3 active, 4 finalized; 10 to 15 for the transitions' own states.
        id: u8,
        /// Its name.
        label: String,
    }
    /// A transition.
    Transition {
        /// 1 configure, 2 cleanup, 3 activate, 4 deactivate, 5 to 7 shutdown from unconfigured, inactive, active.
        id: u8,
        /// Its name; counts when `id` is 0.
        label: String,
    }
    /// A transition with where it starts and ends.
    TransitionDescription {
        /// The transition.
        transition: Transition,
        /// From.
        start_state: State,
        /// To, when all goes well.
        goal_state: State,
    }
    /// A transition happened.
    TransitionEvent {
        /// Nanoseconds since the epoch.
        timestamp: u64,
        /// The transition.
        transition: Transition,
        /// From.
        start_state: State,
        /// To.
        goal_state: State,
    }
    /// Nothing; ROS 2 sends one byte for it.
    #[derive(Copy)]
    GetStateRequest {
        /// Always 0.
        structure_needs_at_least_one_member: u8,
    }
    /// The present state.
    GetStateResponse {
        /// The present state.
        current_state: State,
    }
    /// Which transition.
    ChangeStateRequest {
        /// By id, or by label when the id is 0.
        transition: Transition,
    }
    /// Whether it was done.
    #[derive(Copy)]
    ChangeStateResponse {
        /// Done.
        success: bool,
    }
    /// Nothing; ROS 2 sends one byte for it.
    #[derive(Copy)]
    GetAvailableStatesRequest {
        /// Always 0.
        structure_needs_at_least_one_member: u8,
    }
    /// All states.
    GetAvailableStatesResponse {
        /// All states.
        available_states: Vec<State>,
    }
    /// Nothing; ROS 2 sends one byte for it.
    #[derive(Copy)]
    GetAvailableTransitionsRequest {
        /// Always 0.
        structure_needs_at_least_one_member: u8,
    }
    /// Transitions.
    GetAvailableTransitionsResponse {
        /// Those that can be taken now, or all of the graph's.
        available_transitions: Vec<TransitionDescription>,
    }
}

service! {
    /// The present state.
    "lifecycle_msgs" GetState: GetStateRequest -> GetStateResponse
}
service! {
    /// Takes a transition.
    "lifecycle_msgs" ChangeState: ChangeStateRequest -> ChangeStateResponse
}
service! {
    /// All states.
    "lifecycle_msgs" GetAvailableStates: GetAvailableStatesRequest -> GetAvailableStatesResponse
}
service! {
    /// Transitions.
    "lifecycle_msgs" GetAvailableTransitions: GetAvailableTransitionsRequest -> GetAvailableTransitionsResponse
}
