//! A gripper's process: from every completion, how large the object is and where its centroid lies in the sensor's frame.
//!
//!     cargo run --release --example grasp -- [INSTANCE] [COUNT]
//!
//! INSTANCE: of the daemon (default); COUNT: completions to print (without end).
//!
//! Centroid: the mean of the voxels' centres, weighted with their probability of being filled; its uncertainty is what it would move if all
//! voxels' deviations went together, the worst case. Extent along each axis of the frame: of the voxels whose probability is at least one
//! half, between brackets if each had one deviation less, and one more. From every percept of a grid whose size and place were to be
//! found, as a depth camera's are: the box that the daemon found.

use beo_ipc::text::from_field;
use beo_ipc::{
    Completion, CompletionFrame, CompletionHeader, InstanceName, Percept, PerceptStatus, ReconnectingSubscriber, SubscriberOptions,
};
use std::time::Duration;

type Vector = [f64; 3];

/// A grid in the sensor's frame.
struct Placement<'a> {
    header: &'a CompletionHeader,
    rotation: [Vector; 3],
}

impl<'a> Placement<'a> {
    fn new(header: &'a CompletionHeader) -> Self {
        let [x, y, z, w] = header.orientation;
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        Self { header, rotation }
    }

    /// Centre of a voxel.
    fn centre(&self, index: usize) -> Vector {
        let n = self.header.dims.map(|side| side as usize);
        let ijk = [index / (n[1] * n[2]), index / n[2] % n[1], index % n[2]];
        std::array::from_fn(|axis| {
            let along = |j: usize| (ijk[j] as f64 + 0.5 - n[j] as f64 / 2.0) * f64::from(self.header.voxel_size_m);
            self.header.position_m[axis] + (0..3).map(|j| self.rotation[axis][j] * along(j)).sum::<f64>()
        })
    }

    /// Extent of a voxel along an axis of the frame.
    fn voxel(&self, axis: usize) -> f64 {
        f64::from(self.header.voxel_size_m) * self.rotation[axis].iter().map(|entry| entry.abs()).sum::<f64>()
    }

    /// Extents of the voxels that are `filled`; 0 if there are none.
    fn extent(&self, voxels: usize, filled: impl Fn(usize) -> bool) -> Vector {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in (0..voxels).filter(|index| filled(*index)).map(|index| self.centre(index)) {
            for axis in 0..3 {
                (low[axis], high[axis]) = (low[axis].min(point[axis]), high[axis].max(point[axis]));
            }
        }
        std::array::from_fn(|axis| if low[axis] > high[axis] { 0.0 } else { high[axis] - low[axis] + self.voxel(axis) })
    }
}

fn print(completion: &Completion) {
    let (header, occupancy, deviation) = (completion.header(), completion.occupancy(), completion.deviation());
    if header.frame != CompletionFrame::Grid.code() {
        return println!("#{} is completed in the object's frame: ask for the grid's", header.sequence);
    }
    let placement = Placement::new(header);
    let extent = |deviations: i32| {
        placement.extent(occupancy.len(), |index| i32::from(occupancy[index]) + deviations * i32::from(deviation[index]) >= 128)
    };
    let likely = extent(0);
    if likely[0] == 0.0 {
        return println!("#{} nothing to grasp", header.sequence);
    }
    let (mut centroid, mut moves, mut mass) = ([0.0; 3], [0.0; 3], 0.0);
    for (index, &p) in occupancy.iter().enumerate().filter(|(_, p)| **p > 0) {
        let (point, p) = (placement.centre(index), f64::from(p));
        mass += p;
        (0..3).for_each(|axis| centroid[axis] += p * point[axis]);
    }
    centroid = centroid.map(|sum| sum / mass);
    for (index, &s) in deviation.iter().enumerate().filter(|(_, s)| **s > 0) {
        let point = placement.centre(index);
        (0..3).for_each(|axis| moves[axis] += f64::from(s) * (point[axis] - centroid[axis]).abs() / mass);
    }
    let (least, most) = (extent(-1), extent(1));
    let [x, y, z] = centroid;
    let [dx, dy, dz] = moves;
    let extents: Vec<String> = (0..3).map(|axis| format!("{:.3} [{:.3}, {:.3}]", likely[axis], least[axis], most[axis])).collect();
    println!(
        "#{} in {}: centroid ({x:.3}, {y:.3}, {z:.3}) +- ({dx:.3}, {dy:.3}, {dz:.3}) m, extent {} m",
        header.sequence,
        from_field(&header.frame_id),
        extents.join(" x ")
    );
}

/// Where the object's box is and how big, if the daemon was asked to find out: in the sensor's frame, sides along the object's axes.
fn found_box(percept: &Percept) -> Option<String> {
    let ([x, y, z], [dx, dy, dz]) = (percept.object_position_m, percept.object_position_deviation_m);
    let ([a, b, c], [da, db, dc]) = (percept.object_extent_m, percept.object_extent_deviation_m);
    (percept.status == PerceptStatus::Ok.code() && a > 0.0).then(|| {
        format!(
            "box at ({x:.3}, {y:.3}, {z:.3}) +- ({dx:.3}, {dy:.3}, {dz:.3}) m, sides {a:.3} x {b:.3} x {c:.3} +- ({da:.3}, {db:.3}, {dc:.3}) m"
        )
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = InstanceName::new(&arguments.next().unwrap_or("default".into()))?;
    let count: u64 = arguments.next().map_or(Ok(u64::MAX), |text| text.parse())?;

    let mut subscriber = ReconnectingSubscriber::open_within(&instance, &SubscriberOptions { completion: true }, Duration::from_secs(10))?;
    eprintln!("listening");
    let mut done = 0;
    while done < count {
        subscriber.wait(Some(Duration::from_millis(500)))?;
        while done < count
            && let Some(completion) = subscriber.take_completion()?
        {
            print(&completion);
            done += 1;
        }
        while let Some(percept) = subscriber.take_percept()? {
            if let Some(text) = found_box(&percept) {
                println!("#{} {text}", percept.sequence);
            }
        }
    }
    Ok(())
}
