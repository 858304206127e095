//! Nothing allocates in the contact dynamics and the bipeds' once their workspaces exist.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{posture, vision60};
use decomposition::{Bipeds, ContactDynamics, Pairing, Side};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting per thread.
struct Counting;

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's obligations are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's obligations are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(run: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.with(Cell::get);
    run();
    ALLOCATIONS.with(Cell::get) - before
}

#[test]
fn no_algorithm_allocates() {
    assert!(allocations(|| drop(std::hint::black_box(vec![0_u8; 10]))) > 0, "the counter does not count");
    let robot = vision60();
    let mut dynamics = ContactDynamics::new(&robot.model, 4);
    let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let q = posture(&[0.2; 18]);
    let (v, tau, u) = ([0.1; 18], [0.0; 18], [5.0; 12]);
    let toes = [1, 2].map(|leg: usize| robot.legs[leg].toe);
    let pairing = Pairing::diagonal(robot.mirror.sign);
    let (q_f, _) = Bipeds::split(&q);
    let count = allocations(|| {
        dynamics.motion(&robot.model, &q, &v, &tau, &toes).expect("regular");
        dynamics.impact(&robot.model, &q, &v, &toes).expect("regular");
        bipeds.motion(&q, &v, &u, &[1, 2]).expect("regular");
        bipeds.impact(&q, &v, &[0, 3]).expect("regular");
        bipeds.closed_loop(Side::Front, &pairing, &q_f, &[0.0; 12], &[0.0; 6], &[1, 2]).expect("consistent");
        bipeds.closed_loop(Side::Rear, &pairing, &q_f, &[0.0; 12], &[0.0; 6], &[1, 2]).expect("consistent");
    });
    assert_eq!(count, 0);
}
