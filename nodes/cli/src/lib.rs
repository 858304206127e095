//! tandem: plan, simulate, bag, report, doctor.
