//! The targets.

pub mod c_abi;
pub mod camera;
pub mod config;
pub mod link;
pub mod model;
pub mod observation;
mod plain;
pub mod readers;
pub mod reload;
pub mod ros2;
pub mod shapes;
mod small_model;

/// One parser under attack.
pub struct Target {
    /// Its name on the command line.
    pub name: &'static str,
    /// Takes any bytes and returns; a panic is a finding.
    pub run: fn(&[u8]),
    /// Good inputs to start from, made by the project's own generator.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Most bytes that may be allocated at a time for an input of this many bytes.
    pub most_bytes: fn(usize) -> usize,
}

/// All of them.
pub const TARGETS: [Target; 27] = [
    Target { name: "binvox", run: shapes::binvox, seeds: shapes::binvox_seeds, most_bytes: shapes::most_bytes_of_voxels },
    Target { name: "npy", run: shapes::npy, seeds: shapes::npy_seeds, most_bytes: shapes::most_bytes_of_voxels },
    Target { name: "npz", run: shapes::npz, seeds: shapes::npz_seeds, most_bytes: shapes::most_bytes_of_archive },
    Target { name: "gltf", run: shapes::gltf, seeds: shapes::gltf_seeds, most_bytes: shapes::most_bytes_of_scene },
    Target { name: "off", run: shapes::off, seeds: shapes::off_seeds, most_bytes: shapes::most_bytes_of_mesh },
    Target { name: "obj", run: shapes::obj, seeds: shapes::obj_seeds, most_bytes: shapes::most_bytes_of_mesh },
    Target { name: "stl", run: shapes::stl, seeds: shapes::stl_seeds, most_bytes: shapes::most_bytes_of_mesh },
    Target { name: "ply", run: shapes::ply, seeds: shapes::ply_seeds, most_bytes: shapes::most_bytes_of_mesh },
    Target { name: "model", run: model::run, seeds: model::seeds, most_bytes: model::most_bytes },
    Target { name: "config", run: config::run, seeds: config::seeds, most_bytes: config::most_bytes },
    Target { name: "observation", run: observation::run, seeds: observation::seeds, most_bytes: observation::most_bytes },
    Target { name: "c_abi", run: c_abi::run, seeds: c_abi::seeds, most_bytes: c_abi::most_bytes },
    Target { name: "png_image", run: camera::png, seeds: camera::png_seeds, most_bytes: camera::most_bytes_of_image },
    Target { name: "jpeg_image", run: camera::jpeg, seeds: camera::jpeg_seeds, most_bytes: camera::most_bytes_of_image },
    Target { name: "tiff_image", run: camera::tiff, seeds: camera::tiff_seeds, most_bytes: camera::most_bytes_of_image },
    Target { name: "npy_image", run: camera::npy, seeds: camera::npy_seeds, most_bytes: camera::most_bytes_of_image },
    Target { name: "camera_info", run: camera::camera_info, seeds: camera::camera_info_seeds, most_bytes: camera::most_bytes_of_text },
    Target { name: "scene_camera", run: camera::scene_camera, seeds: camera::scene_camera_seeds, most_bytes: camera::most_bytes_of_text },
    Target { name: "trajectory", run: camera::trajectory, seeds: camera::trajectory_seeds, most_bytes: camera::most_bytes_of_text },
    Target { name: "percept", run: readers::percept, seeds: readers::percept_seeds, most_bytes: readers::most_bytes_of_percept },
    Target {
        name: "completion",
        run: readers::completion,
        seeds: readers::completion_seeds,
        most_bytes: readers::most_bytes_of_completion,
    },
    Target { name: "picture", run: readers::picture, seeds: readers::picture_seeds, most_bytes: readers::most_bytes_of_picture },
    Target { name: "status", run: readers::status, seeds: readers::status_seeds, most_bytes: readers::most_bytes_of_status },
    Target { name: "reload", run: reload::run, seeds: reload::seeds, most_bytes: reload::most_bytes },
    Target { name: "link", run: link::run, seeds: link::seeds, most_bytes: link::most_bytes },
    Target { name: "ros2", run: ros2::run, seeds: ros2::seeds, most_bytes: ros2::most_bytes },
    Target { name: "alignment", run: shapes::alignment, seeds: shapes::alignment_seeds, most_bytes: shapes::most_bytes_of_mesh },
];
