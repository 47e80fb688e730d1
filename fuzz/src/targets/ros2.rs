//! Messages that `beo-ros2` takes from the graph, from whoever publishes: CDR, in either byte order, as the crate of its transport reads it.

#[path = "../../../ipc/ros2/src/images.rs"]
mod images;
#[path = "../../../ipc/ros2/src/pairing.rs"]
mod pairing;

use crate::messages::{CameraInfo, Header, Image, Time};
use byteorder::{BigEndian, ByteOrder, LittleEndian};
use serde::de::DeserializeOwned;
use std::time::Duration;

/// A message after the four bytes that say how it is encoded; of those, the second is 0 for the big end first.
fn read<M: DeserializeOwned>(data: &[u8]) -> Option<M> {
    fn of<M: DeserializeOwned, O: ByteOrder>(body: &[u8]) -> Option<M> {
        cdr_encoding::from_bytes::<M, O>(body).ok().map(|(message, _)| message)
    }
    let (head, body) = data.split_at_checked(4)?;
    if head[1] & 1 == 0 { of::<M, BigEndian>(body) } else { of::<M, LittleEndian>(body) }
}

/// Any bytes as an image, of depths and of labels, which meets another of the same and of another time; and as a camera. What is read has as many
/// pixels as the image says, and a camera gives rays that are numbers.
pub fn run(data: &[u8]) {
    if let Some(image) = read::<Image>(data) {
        let pixels = u64::from(image.width) * u64::from(image.height);
        let depths = images::depth_of(&image).map(|depths| depths.len());
        let labels = images::labels_of(&image).map(|labels| labels.len());
        for count in [depths, labels].into_iter().flatten() {
            assert_eq!(count as u64, pixels);
        }
        let mut pairing = pairing::Pairing::new(true, Duration::from_millis(5));
        for sec in [0, image.header.stamp.sec] {
            let other = Image { header: Header { stamp: Time { sec, nanosec: 0 }, frame_id: String::new() }, ..Image::default() };
            let _ = pairing.depth(other);
            let _ = pairing.labels(image.clone());
        }
        let _ = pairing.depth(image);
        assert!(pairing.unpaired() <= 5, "of each kind, no more images are passed over than came");
    }
    if let Some(info) = read::<CameraInfo>(data) {
        for is_rectified in [false, true] {
            let Ok(intrinsics) = images::intrinsics_of(&info, is_rectified) else { continue };
            assert!(intrinsics.focal().iter().chain(&intrinsics.centre()).all(|value| value.is_finite()));
            let _ = images::check_size("depth", &Image::default(), &intrinsics);
        }
    }
}

/// The message, and its pixels as depths and labels; and room for what reading sets aside before it finds the bytes missing.
pub fn most_bytes(len: usize) -> usize {
    64 * len + (1 << 20)
}

/// Seeds: images of every encoding, and cameras of every lens.
pub fn seeds() -> Vec<Vec<u8>> {
    fn written<M: serde::Serialize>(message: &M) -> [Vec<u8>; 2] {
        let body = |order: u8, bytes: Vec<u8>| [&[0, order, 0, 0], &bytes[..]].concat();
        let little = cdr_encoding::to_vec::<M, LittleEndian>(message).expect("it has a size");
        let big = cdr_encoding::to_vec::<M, BigEndian>(message).expect("it has a size");
        [body(1, little), body(0, big)]
    }
    let header = || Header { stamp: Time { sec: 17, nanosec: 5_000_000 }, frame_id: "camera_depth_optical_frame".into() };
    let image = |(encoding, bytes, is_bigendian): (&str, u32, u8)| {
        let (width, height) = (6, 4);
        let data = (0..width * height * bytes).map(|byte| (byte % 200) as u8).collect();
        Image { header: header(), width, height, step: width * bytes, encoding: encoding.into(), is_bigendian, data }
    };
    let camera = |(model, d): (&str, usize)| CameraInfo {
        header: header(),
        width: 640,
        height: 480,
        distortion_model: model.into(),
        d: (0..d).map(|n| 0.01 * n as f64).collect(),
        k: [600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0],
        p: [500.0, 0.0, 310.0, 0.0, 0.0, 510.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        binning_x: 1,
        binning_y: 2,
        ..CameraInfo::default()
    };
    let images = [("32FC1", 4, 0), ("16UC1", 2, 1), ("mono8", 1, 0), ("32SC1", 4, 1)];
    let cameras = [("plumb_bob", 5), ("rational_polynomial", 8), ("equidistant", 4), ("", 0)];
    let images = images.into_iter().flat_map(|of| written(&image(of)));
    images.chain(cameras.into_iter().flat_map(|of| written(&camera(of)))).collect()
}
