//! A camera-side process: writes a partial grid in place into shared memory, thirty times a second.
//!
//!     cargo run --release --example camera -- [INSTANCE] [COUNT]
//!
//! It needs a running daemon: `beo serve --model models/modelnet10.safetensors --instance INSTANCE`. The object is a made-up
//! table top, seen from above: known voxels are written as 0 (empty) or 1 (filled), hidden ones as 255 (unknown).

use beo_ipc::{InstanceName, ObservationHeader, Producer, View};
use std::time::Duration;

const SIDE: usize = 30;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = InstanceName::new(&arguments.next().unwrap_or("default".into()))?;
    let count: u64 = arguments.next().map_or(Ok(90), |text| text.parse())?;

    let mut template = ObservationHeader::new([SIDE as u32; 3]);
    template.view = View::TopDown.code();
    template.voxel_size_m = 0.04;
    let producer = Producer::open_within(&instance, &template, Duration::from_secs(10))?;
    for _ in 0..count {
        let mut loan = producer.loan()?;
        for (index, voxel) in loan.voxels_mut().iter_mut().enumerate() {
            let (x, y, z) = (index / (SIDE * SIDE), index / SIDE % SIDE, index % SIDE);
            let under_the_top = (3..27).contains(&x) && (7..23).contains(&y);
            *voxel = match z {
                21 if under_the_top => 1,
                0..21 if under_the_top => 255,
                _ => 0,
            };
        }
        let sent = loan.send()?;
        println!("sent observation {}", sent.sequence);
        std::thread::sleep(Duration::from_millis(33));
    }
    Ok(())
}
