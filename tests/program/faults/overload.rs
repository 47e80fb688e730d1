//! Far more observations than can be answered.
