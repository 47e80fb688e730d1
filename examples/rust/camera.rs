//! A camera's process: writes a partial grid in place into shared memory, thirty times a second.
//!
//!     cargo run --release --example camera -- [INSTANCE] [COUNT] [SIDE]
//!
//! INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30). The object is a
//! made-up table, seen from above: known voxels are 0 (empty) or 1 (filled), hidden ones 255 (unknown).

use beo_ipc::{InstanceName, ObservationHeader, OpenError, ReconnectError, ReconnectingProducer, View, text};
use std::time::{Duration, Instant};

fn write_table_top(voxels: &mut [u8], side: usize) {
    let (x_range, y_range, top) = (side / 10..side - side / 10, side / 4..side - side / 4, side * 7 / 10);
    for (index, voxel) in voxels.iter_mut().enumerate() {
        let (x, y, z) = (index / (side * side), index / side % side, index % side);
        let under_the_top = x_range.contains(&x) && y_range.contains(&y);
        *voxel = match z {
            _ if !under_the_top || z > top => 0,
            _ if z == top => 1,
            _ => 255,
        };
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = InstanceName::new(&arguments.next().unwrap_or("default".into()))?;
    let count: u64 = arguments.next().map_or(Ok(90), |text| text.parse())?;
    let side: u32 = arguments.next().map_or(Ok(30), |text| text.parse())?;

    // What the grid is and where it lies. The grid stands 0.8 m before the sensor, turned by a quarter about z.
    let mut template = ObservationHeader::new([side; 3]);
    template.view = View::TopDown.code();
    template.voxel_size_m = 1.2 / side as f32;
    template.position_m = [0.8, 0.0, 0.4];
    template.orientation = [0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2];
    template.frame_id = text::to_field("camera");

    let mut producer = ReconnectingProducer::open_within(&instance, &template, Duration::from_secs(10))?;
    let mut next = Instant::now();
    let mut sent = 0;
    while sent < count {
        match producer.loan() {
            Ok(mut loan) => {
                write_table_top(loan.voxels_mut(), side as usize);
                println!("sent observation {}", loan.send()?.sequence);
                sent += 1;
            }
            // The daemon is away: this grid is left out.
            Err(ReconnectError::Open(OpenError::NotRunning { .. })) => {}
            Err(error) => return Err(error.into()),
        }
        next += Duration::from_micros(33_333);
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    Ok(())
}
