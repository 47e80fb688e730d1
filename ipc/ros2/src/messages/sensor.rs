//! `sensor_msgs`: images, cameras, clouds.

use super::Header;

super::messages! {
    Image {
        header: Header, height: u32, width: u32, encoding: String, is_bigendian: u8, step: u32,
        #[serde(with = "serde_bytes")] data: Vec<u8>,
    }
    RegionOfInterest { x_offset: u32, y_offset: u32, height: u32, width: u32, do_rectify: bool }
    CameraInfo {
        header: Header, height: u32, width: u32, distortion_model: String, d: Vec<f64>, k: [f64; 9], r: [f64; 9], p: [f64; 12],
        binning_x: u32, binning_y: u32, roi: RegionOfInterest,
    }
    PointField { name: String, offset: u32, datatype: u8, count: u32 }
    PointCloud2 {
        header: Header, height: u32, width: u32, fields: Vec<PointField>, is_bigendian: bool, point_step: u32, row_step: u32,
        #[serde(with = "serde_bytes")] data: Vec<u8>, is_dense: bool,
    }
    CompressedImage { header: Header, format: String, #[serde(with = "serde_bytes")] data: Vec<u8> }
}
super::topics!("sensor_msgs": Image, CameraInfo, PointCloud2);

impl PointField {
    /// `datatype` of 32-bit unsigned numbers.
    pub const UINT32: u8 = 6;
    /// `datatype` of 32-bit floating-point numbers.
    pub const FLOAT32: u8 = 7;
}
