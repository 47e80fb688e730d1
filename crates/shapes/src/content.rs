//! Content of a file of shapes, whatever its format.

use super::resample::stand_up;
use super::{FormatError, Mesh, MeshError, PointCloud, Up};
use beo_core::grid::Occupancy;

/// Content of a file of shapes.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Voxels.
    Voxels(Occupancy),
    /// A mesh, its axes as in the file.
    Mesh(Mesh),
    /// Points without triangles, their axes as in the file.
    Points(PointCloud),
}

impl Content {
    /// The mesh, or an error that says what there is instead.
    pub(super) fn into_mesh(self) -> Result<Mesh, FormatError> {
        match self {
            Self::Mesh(mesh) => Ok(mesh),
            Self::Points(cloud) => Err(MeshError::PointCloud(cloud.points().len()).into()),
            Self::Voxels(_) => Err(MeshError::NoTriangle.into()),
        }
    }

    /// Turned so that the `up` axis is z.
    pub fn turned_up(self, up: Up) -> Self {
        match self {
            Self::Voxels(object) if up == Up::Y => Self::Voxels(stand_up(&object)),
            Self::Voxels(object) => Self::Voxels(object),
            Self::Mesh(mesh) => Self::Mesh(mesh.turned_up(up)),
            Self::Points(cloud) => Self::Points(cloud.turned_up(up)),
        }
    }
}
