use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting what each thread allocates and frees. A test makes it its global allocator and
/// compares [`allocations_of_this_thread`] before and after:
///
/// ```
/// #[global_allocator]
/// static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;
///
/// let before = realtime::allocations_of_this_thread();
/// let sum: u32 = (0..100).sum();
/// assert_eq!(realtime::allocations_of_this_thread(), before);
/// let list: Vec<u32> = (0..sum).collect();
/// assert!(realtime::allocations_of_this_thread() > before);
/// # drop(list);
/// ```
pub struct CountingAllocator;

/// Allocations, reallocations and releases of this thread so far. Stays 0 unless [`CountingAllocator`] is the global
/// allocator.
pub fn allocations_of_this_thread() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

fn count() {
    // A thread that is being torn down has no counter any more.
    let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as promised to us.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: as promised to us.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count();
        // SAFETY: as promised to us.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}
