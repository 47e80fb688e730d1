//! beo
