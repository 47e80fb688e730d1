//! Grids into a folder: each as `.npy` with a `.json` that says where it lies.

use super::sink::{Finish, Observed, Shown, Sink};
use crate::cli::failure::{Failure, cannot_write};
use beo_camera::carve;
use beo_camera::{Carver, FrameGrids};
use beo_core::grid::{Dims, Observation};
use beo_core::whole_file::write_whole;
use beo_ipc::CarvedGrid;
use beo_picture::Image;
use beo_shapes::{write_npy_labels, write_npy_observation};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Grids into a folder.
pub(super) struct Files {
    folder: PathBuf,
    written: u64,
    voxels: Vec<u8>,
}

impl Files {
    /// Nothing is written yet. The folder is made if it is not there.
    pub(super) fn new(folder: &Path, dims: Dims) -> Result<Self, Failure> {
        std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        Ok(Self { folder: folder.into(), written: 0, voxels: vec![0; dims.voxels()] })
    }

    /// Grids written so far.
    pub(super) fn written(&self) -> u64 {
        self.written
    }

    /// The number of grids written and their folder, in words.
    pub(super) fn summary(&self) -> String {
        format!("{} grids written to {}", self.written, self.folder.display())
    }
}

impl Sink for Files {
    fn segmented(&mut self, of: &Shown<'_>, grids: &FrameGrids) -> Result<(), Failure> {
        let Some(segments) = grids.segments() else { return Ok(()) };
        let path = self.folder.join(format!("{}_label.npy", of.frame));
        let mut bytes = Vec::new();
        write_npy_labels(&mut bytes, grids.size(), segments)?;
        write_whole(&path, &bytes).map_err(cannot_write(&path))
    }

    /// Nobody looks on.
    fn show<'i>(&mut self, _: &Shown<'_>, _: &dyn Fn() -> &'i Image) {}

    fn take(&mut self, of: &Shown<'_>, carver: &Carver<'_>, observed: &Observed, finish: &mut Finish<'_>) -> Result<(), Failure> {
        let quality = &observed.quality;
        carve(carver, &mut self.voxels)?;
        finish(&mut self.voxels)?;
        let grid = &carver.grid;
        let [x, y, z] = grid.dims();
        let observation = Observation::from_bytes(Dims::new(x, y, z)?, &self.voxels)?;
        let mut bytes = Vec::new();
        write_npy_observation(&mut bytes, &observation)?;
        let header = CarvedGrid::from(grid);
        let beside = json!({
            "frame": of.frame,
            "object": carver.object,
            "dims": header.dims,
            "voxel_size_m": header.voxel_size_m,
            "frame_id": of.frame_id,
            "position_m": header.position_m,
            "orientation": header.orientation,
            "sensor_position_m": header.camera_position_m,
            "fused": of.fused,
            "cut": { "border": quality.cut.border, "occluder": quality.cut.occluder },
            "readings": quality.readings,
            "share_support": quality.share_support,
            "share_edge": quality.share_edge,
            "share_far": quality.share_far,
            "surface_deviation_m": quality.surface_deviation_m,
        });
        let stem = format!("{}-{}", of.frame, carver.object);
        for (end, content) in [("npy", bytes), ("json", format!("{beside:#}\n").into_bytes())] {
            let path = self.folder.join(format!("{stem}.{end}"));
            write_whole(&path, &content).map_err(cannot_write(&path))?;
        }
        self.written += 1;
        Ok(())
    }

    fn frame_ended(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}
