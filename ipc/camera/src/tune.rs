//! TEMPORARY knobs for experiments.
#[macro_export]
#[doc(hidden)]
macro_rules! knob { ($n:literal, $d:expr) => {{ static K: std::sync::OnceLock<f64> = std::sync::OnceLock::new(); *K.get_or_init(|| std::env::var($n).ok().and_then(|v| v.parse().ok()).unwrap_or($d as f64)) }} }
