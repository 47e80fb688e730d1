#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| beo_fuzz::targets::ros2::run(data));
