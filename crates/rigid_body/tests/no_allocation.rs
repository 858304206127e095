//! Nothing allocates once `Data` exists.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{Random, random_state, vision60};
use rigid_body::{
    Data, aba, bias_forces, center_of_mass, crba, forward_kinematics, frame_position, kinetic_energy,
    last_point_kinematics, point_kinematics_derivatives, potential_energy, rnea, rnea_derivatives,
};

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
    for model in [vision60(), vision60().as_general_tree()] {
        let mut data = Data::new(&model);
        let s = random_state(&model, &mut Random(9));
        let toe = s.forces[0].0;
        let (q, v, a, forces) = (&s.q[..], &s.v[..], &s.a[..], &s.forces[..]);
        let count = allocations(|| {
            rnea(&model, &mut data, q, v, a, forces);
            rnea_derivatives(&model, &mut data, q, v, a, forces);
            bias_forces(&model, &mut data, q, v);
            crba(&model, &mut data, q);
            aba(&model, &mut data, q, v, a, forces);
            forward_kinematics(&model, &mut data, q, v, a);
            last_point_kinematics(&model, &mut data, toe);
            point_kinematics_derivatives(&model, &mut data, q, v, a, toe);
            frame_position(&model, &data, toe);
            center_of_mass(&model, &mut data, q, v);
            kinetic_energy(&model, &mut data, q, v);
            potential_energy(&model, &mut data, q);
        });
        assert_eq!(count, 0);
    }
}
