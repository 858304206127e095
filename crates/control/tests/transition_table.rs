//! Every mode × every event × every combination of guards, against an independent statement of what must hold, and the
//! table itself against a written-down copy.

use control::{Event, Guards, Mode, Refusal, Tilted, transition};

const ON_ITS_SIDE: Tilted = Tilted { roll_deg: -90, pitch_deg: 0 };

fn all_guards() -> impl Iterator<Item = Guards> {
    (0..512).map(|n: u32| Guards {
        fresh: n & 1 != 0,
        posture_safe: n & 2 != 0,
        gait_loaded: n & 4 != 0,
        any_fault: n & 8 != 0,
        emergency_stop: n & 16 != 0,
        start_on_gait_allowed: n & 32 != 0,
        estimate_usable: n & 64 != 0,
        velocity_heeded: n & 128 != 0,
        tilted: (n & 256 != 0).then_some(ON_ITS_SIDE),
    })
}

/// The table with everything in order. Rows: modes; columns: events in the order of `Event::ALL`. `-` is a refusal.
const TABLE: &str = "
mode         Arm          Disarm   Stand       Sit          Walk        Stop         StartOnGait PostureReached SwitchReached VelocityAsked VelocityRests EmergencyStop Stale    FaultLatched FaultsCleared
disarmed     damping      disarmed -           -            -           disarmed     walking     disarmed       disarmed      disarmed      disarmed      disarmed      disarmed disarmed     disarmed
damping      damping      disarmed standing_up -            -           damping      -           damping        damping       damping       damping       damping       damping  fault        damping
standing_up  standing_up  -        standing_up sitting_down standing_up standing_up  -           standing       standing_up   standing_up   standing_up   damping       damping  fault        standing_up
standing     standing     -        standing    sitting_down starting    standing     -           standing       standing      starting      standing      damping       damping  fault        standing
starting     starting     -        standing    -            starting    standing     -           walking        starting      starting      standing      damping       damping  fault        starting
walking      walking      -        stopping    -            walking     stopping     -           walking        walking       walking       stopping      damping       damping  fault        walking
stopping     stopping     -        stopping    -            walking     stopping     -           stopping       standing      walking       stopping      damping       damping  fault        stopping
sitting_down sitting_down -        standing_up sitting_down -           sitting_down -           disarmed       sitting_down  sitting_down  sitting_down  damping       damping  fault        sitting_down
fault        -            disarmed -           -            -           fault        -           fault          fault         fault         fault         fault         fault    fault        damping
";

#[test]
fn every_mode_and_event_leads_where_the_table_says() {
    let mut lines = TABLE.trim().lines();
    let events: Vec<&str> = lines.next().unwrap().split_whitespace().skip(1).collect();
    assert_eq!(events, Event::ALL.map(|e| format!("{e:?}")));
    let mut rows = 0;
    for (line, mode) in lines.zip(Mode::ALL) {
        let cells: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(cells[0], mode.name());
        for (event, cell) in Event::ALL.into_iter().zip(&cells[1..]) {
            let got = transition(mode, event, &Guards::READY);
            let got_name = got.as_ref().map_or("-", |m| m.name());
            assert_eq!(got_name, *cell, "{mode:?} × {event:?}: {got:?}");
            if let Err(refusal) = got {
                let text = refusal.to_string();
                assert!(text.len() > 20 && text.contains("refused"), "{text}");
            }
        }
        rows += 1;
    }
    assert_eq!(rows, Mode::ALL.len());
}

#[test]
fn no_guards_open_a_way_that_must_stay_shut() {
    let mut cells = 0;
    for guards in all_guards() {
        for mode in Mode::ALL {
            for event in Event::ALL {
                cells += 1;
                let Ok(to) = transition(mode, event, &guards) else {
                    assert!(
                        !matches!(
                            event,
                            Event::PostureReached
                                | Event::SwitchReached
                                | Event::VelocityAsked
                                | Event::VelocityRests
                                | Event::EmergencyStop
                                | Event::Stale
                                | Event::FaultLatched
                                | Event::FaultsCleared
                                | Event::Stop
                        ),
                        "{mode:?} × {event:?} was refused; the controller's own events and stop never are"
                    );
                    continue;
                };
                let context = format!("{mode:?} × {event:?} → {to:?}, {guards:?}");
                if mode == Mode::Disarmed && to != Mode::Disarmed {
                    assert!(matches!(event, Event::Arm | Event::StartOnGait), "{context}");
                }
                if event == Event::Arm && mode == Mode::Disarmed {
                    assert_eq!(to, Mode::Damping, "{context}: arming moves nothing");
                }
                let comes_alive = !mode.is_moving() && to.is_moving();
                if comes_alive {
                    assert!(guards.fresh && !guards.any_fault && !guards.emergency_stop, "{context}");
                    assert!(matches!(event, Event::Stand | Event::StartOnGait), "{context}");
                    assert!(guards.posture_safe || event == Event::StartOnGait, "{context}");
                    assert!(guards.tilted.is_none() || event == Event::StartOnGait, "{context}");
                }
                if event == Event::VelocityAsked && to != mode {
                    assert!(matches!(mode, Mode::Standing | Mode::Stopping), "{context}");
                    assert!(guards.velocity_heeded && guards.fresh && !guards.emergency_stop, "{context}");
                }
                if event == Event::StartOnGait {
                    assert!(guards.start_on_gait_allowed, "{context}");
                }
                if matches!(to, Mode::Starting | Mode::Walking) && to != mode {
                    assert!(guards.gait_loaded || event == Event::PostureReached, "{context}");
                    assert!(!guards.any_fault || event == Event::PostureReached, "{context}");
                    assert!(guards.estimate_usable || event == Event::PostureReached, "{context}");
                }
                if mode.is_moving() && matches!(event, Event::EmergencyStop | Event::Stale) {
                    assert_eq!(to, Mode::Damping, "{context}");
                }
                if mode.drives_on() && event == Event::FaultLatched {
                    assert_eq!(to, Mode::Fault, "{context}");
                }
                if mode == Mode::Fault && to != Mode::Fault {
                    assert!(matches!(event, Event::FaultsCleared | Event::Disarm), "{context}");
                }
                // A robot on its feet is never switched off but by having sat down.
                if mode.is_moving() && to == Mode::Disarmed {
                    assert!(mode == Mode::SittingDown && event == Event::PostureReached, "{context}");
                }
            }
        }
    }
    assert_eq!(cells, 512 * Mode::ALL.len() * Event::ALL.len());
}

/// Whatever else is to be done first: it would only be asked for in vain.
#[test]
fn a_robot_on_its_side_is_told_so_by_arm_and_stand() {
    let guards = Guards { tilted: Some(ON_ITS_SIDE), any_fault: true, ..Guards::READY };
    for (mode, event) in [
        (Mode::Disarmed, Event::Arm),
        (Mode::Fault, Event::Arm),
        (Mode::Disarmed, Event::Stand),
        (Mode::Damping, Event::Stand),
        (Mode::Fault, Event::Stand),
    ] {
        assert_eq!(transition(mode, event, &guards), Err(Refusal::Tilted(ON_ITS_SIDE)), "{mode:?} × {event:?}");
    }
    let said = Refusal::Tilted(ON_ITS_SIDE).to_string();
    assert!(said.contains("onto its left side (roll -90°") && said.contains("does not right itself"), "{said}");
    // The button comes first, and nothing else waits for the robot to be turned.
    let pressed = Guards { emergency_stop: true, ..guards };
    assert_eq!(transition(Mode::Disarmed, Event::Arm, &pressed), Err(Refusal::EmergencyStop));
    assert_eq!(transition(Mode::Fault, Event::Disarm, &guards), Ok(Mode::Disarmed));
}
