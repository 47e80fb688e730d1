//! Hours of random faults, on request.
