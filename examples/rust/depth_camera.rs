//! A depth camera's driver: frame in, table, where the object's grid lies, carving, commit; thirty times a second.
//!
//!     cargo run --release --example depth_camera -- [INSTANCE] [COUNT] [SIDE] [SEGMENTATION]
//!
//! INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30).
//! SEGMENTATION: mask, the camera comes with labels (default); table, it does not, and what stands on the table is the object.
//!
//! For your own camera, replace `intrinsics` and `next_frame`: the made-up one looks down on a box that turns on a table.

use beo_camera::{Carver, Frame, Grid, GridOptions, Intrinsics, Observer, Placement, PlaneSearch, SensorModel, fit_support, place};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{CarvedGrid, CarvedGridError, InstanceName, ObservationHeader, OpenError, ReconnectError, ReconnectingProducer};
use nalgebra::Vector3;
use std::time::{Duration, Instant};

/// The label of the object in the mask. For several objects, do the second half of `main`'s loop for each label.
const OBJECT: u16 = 1;

/// From your camera's calibration: width, height, focal lengths, principal point, distortion (k1, k2, p1, p2, k3).
fn intrinsics() -> Intrinsics {
    Intrinsics::new(320, 240, [277.0, 277.0], [160.3, 119.1], [0.0; 5]).expect("numbers of a camera")
}

/// A frame of a camera.
struct Images {
    /// Metres; 0: no reading.
    depth_m: Vec<f32>,
    /// From your segmentation, if there is one; 0: no object.
    labels: Option<Vec<u16>>,
    /// CLOCK_MONOTONIC.
    captured_ns: u64,
}

/// Waits for the next frame of the camera. REPLACE THIS: here, a box of 7 × 10 × 14 cm on a table is made up, in steps of a millimetre.
fn next_frame(intrinsics: &Intrinsics, has_labels: bool, number: u32, start: Instant) -> Images {
    std::thread::sleep((Duration::from_micros(33_333) * number).saturating_sub(start.elapsed()));
    // The camera is 0.4 m above the table and looks down by 0.55 rad; the box stands 0.55 m before it.
    let ((sin, cos), turned) = (0.55_f64.sin_cos(), 0.3 + 0.02 * f64::from(number));
    let (up, ahead, right) = (Vector3::new(0.0, -cos, -sin), Vector3::new(0.0, -sin, cos), Vector3::x());
    let axes = [right * turned.cos() + ahead * turned.sin(), ahead * turned.cos() - right * turned.sin(), up];
    let (half, centre) = ([0.035, 0.05, 0.07], ahead * 0.55 - up * 0.33);
    let captured_ns = monotonic_ns();
    let pixels = (0..intrinsics.height()).flat_map(|v| (0..intrinsics.width()).map(move |u| [f64::from(u), f64::from(v)]));
    let (depth_m, labels): (_, Vec<u16>) = pixels
        .map(|pixel| {
            let ray = intrinsics.ray(pixel);
            let (mut enter, mut leave) = (0.0_f64, 10.0_f64);
            for (axis, half) in axes.iter().zip(half) {
                let along = axis.dot(&ray);
                let (middle, width) = (axis.dot(&centre) / along, half / along.abs());
                (enter, leave) = (enter.max(middle - width), leave.min(middle + width));
            }
            let table = -0.4 / up.dot(&ray);
            let (depth, label) = match enter < leave {
                true => (enter, OBJECT),
                false => (if table > 0.0 && table < 5.0 { table } else { 0.0 }, 0),
            };
            ((0.001 * (1000.0 * depth + 0.5).floor()) as f32, label)
        })
        .unzip();
    Images { depth_m, labels: has_labels.then_some(labels), captured_ns }
}

/// Where a grid lies and where the camera is; size, place and rotation about the vertical are to be found.
fn header(grid: &Grid) -> Result<ObservationHeader, CarvedGridError> {
    ObservationHeader::of_grid(&CarvedGrid { object_id: OBJECT.into(), ..grid.into() })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = InstanceName::new(&arguments.next().unwrap_or("default".into()))?;
    let count: u64 = arguments.next().map_or(Ok(90), |text| text.parse())?;
    let side: usize = arguments.next().map_or(Ok(30), |text| text.parse())?;
    let has_labels = match arguments.next().as_deref() {
        None | Some("mask") => true,
        Some("table") => false,
        Some(other) => return Err(format!("SEGMENTATION is mask or table, not {other}").into()),
    };

    // The sensor's noise, what is up, if you know it, and the object's size, if you know it, go in here.
    let (sensor, placement) = (SensorModel::default(), Placement::default());
    let search = PlaneSearch { label: None, up: None, sensor };
    let mut observer = Observer::new(GridOptions { sensor, ..GridOptions::new([side; 3]) });
    let intrinsics = intrinsics();

    let template = ObservationHeader::new([side as u32; 3]);
    let mut producer = ReconnectingProducer::open_within(&instance, &template, Duration::from_secs(10))?;
    let (start, mut sent, mut table) = (Instant::now(), 0, None);
    for number in 0.. {
        if sent == count {
            break;
        }
        let images = next_frame(&intrinsics, has_labels, number, start);
        let labels = images.labels.unwrap_or_else(|| observer.segment_table(&intrinsics, &images.depth_m));
        let frame = Frame::new(&intrinsics, &images.depth_m, &labels)?;
        // Where the table is hidden, it is where it was.
        table = fit_support(&frame, &search).or(table);
        let Some(support) = table else { continue };
        // An object that is hardly seen is left out of this frame.
        let Ok(grid) = place(&frame, OBJECT, &support.normal(), Some(&support), &sensor, [side; 3], &placement) else { continue };
        match producer.loan() {
            Ok(mut loan) => {
                Carver { frame, object: OBJECT, sensor, support: Some(support), grid }.carve(loan.voxels_mut())?;
                let producer_id = loan.header().producer_id;
                *loan.header_mut() = ObservationHeader { producer_id, capture_ns: images.captured_ns, ..header(&grid)? };
                println!("sent observation {}", loan.send()?.sequence);
                sent += 1;
            }
            // The daemon is away: this frame is left out.
            Err(ReconnectError::Open(OpenError::NotRunning { .. })) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
