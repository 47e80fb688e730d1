//! From an image to observations: decode, segment, lay grids, carve them into shared memory, send.

use crate::arguments::{Arguments, Masks};
use crate::health::Count;
use crate::images::{ImageError, check_size, depth_of, intrinsics_of, labels_of};
use crate::messages::CameraInfo;
use crate::pairing::Pair;
use crate::shared::Shared;
use beo_camera::{Carver, Frame, GridOptions, Observer, Quality, Segmentation, carve};
use beo_ipc::text::to_field;
use beo_ipc::{CarvedGrid, ObservationHeader, OpenError, ReconnectError, ReconnectingProducer};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// An image on its way.
#[derive(Clone, Debug)]
pub struct Work {
    /// The images.
    pub pair: Pair,
    /// The camera.
    pub info: Arc<CameraInfo>,
    /// When it came, CLOCK_MONOTONIC.
    pub arrived_ns: u64,
}

/// Why an image or an object is left out.
#[derive(Debug, thiserror::Error)]
pub enum PerceiveError {
    /// The image.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The daemon.
    #[error(transparent)]
    Daemon(#[from] ReconnectError),
    /// The grid.
    #[error(transparent)]
    Grid(#[from] beo_ipc::CarvedGridError),
    /// The carving.
    #[error(transparent)]
    Carving(#[from] beo_camera::GridError),
    /// The sending.
    #[error(transparent)]
    Send(#[from] beo_ipc::SendError),
}

/// Looks at images, one after another.
pub struct Perceiving {
    arguments: Arguments,
    shared: Arc<Shared>,
    /// For grids of these dims.
    link: Option<([u32; 3], ReconnectingProducer)>,
    observer: Option<Observer>,
}

impl Perceiving {
    /// Nothing is looked at yet.
    pub fn new(arguments: Arguments, shared: Arc<Shared>) -> Self {
        Self { arguments, shared, link: None, observer: None }
    }

    /// Sends the objects of an image to the daemon. What is wrong with one object is said, and keeps no other from being sent.
    ///
    /// # Errors
    /// [`PerceiveError`] if the image cannot be used, or no daemon is there.
    pub fn frame(&mut self, work: &Work) -> Result<(), PerceiveError> {
        let Pair { depth: image, labels } = &work.pair;
        let intrinsics = intrinsics_of(&work.info, self.arguments.rectified)?;
        check_size("depth", image, &intrinsics)?;
        let depth = depth_of(image)?;
        let labels = match labels {
            Some(labels) => {
                check_size("segmentation", labels, &intrinsics)?;
                labels_of(labels)?
            }
            None => vec![0; depth.len()],
        };
        let frame = Frame::new(&intrinsics, &depth, &labels).expect("both images have the camera's size");
        let dims = self.connect()?;
        let masks = match self.arguments.segmentation {
            Masks::Own => Segmentation::Table,
            Masks::Topic => Segmentation::Labels,
        };
        let sides = dims.map(|side| side as usize);
        let mut observer = self
            .observer
            .take()
            .filter(|observer| observer.options().dims == sides)
            .unwrap_or_else(|| Observer::new(GridOptions { segmentation: masks, ..GridOptions::new(sides) }));
        let grids = observer.observe(&frame);
        self.observer = Some(observer);
        let mut header = image.header.clone();
        if let Some(frame_id) = &self.arguments.frame_id {
            header.frame_id.clone_from(frame_id);
        }
        let stamp_ns = u64::try_from(header.stamp.nanoseconds()).unwrap_or(0);
        let said = Said { arrived_ns: work.arrived_ns, stamp_ns, frame_id: to_field(&header.frame_id) };
        let with_grid = grids.objects.iter().filter(|object| object.grid.is_ok()).map(|object| u64::from(object.object));
        self.shared.frames().ask(work.arrived_ns, header, with_grid);
        for laid in &grids.objects {
            let observed = match &laid.grid {
                Ok(observed) => observed,
                Err(reason) => {
                    self.shared.health.count(Count::NoGrid);
                    self.shared.health.trouble("no grid", reason);
                    continue;
                }
            };
            match self.send(&grids.carver(laid.object, observed), &observed.quality, &said) {
                Ok(()) => self.shared.health.count(Count::Sent),
                Err(error) => {
                    self.shared.frames().withdraw(work.arrived_ns, laid.object.into());
                    self.shared.health.count(Count::NotSent);
                    self.shared.health.trouble("object", &error);
                }
            }
        }
        Ok(())
    }

    /// Joins the daemon with grids of its model's dims; those dims.
    fn connect(&mut self) -> Result<[u32; 3], PerceiveError> {
        let instance = &self.arguments.instance;
        let away = || ReconnectError::from(OpenError::NotRunning { instance: instance.clone() });
        let dims = self.shared.status().ok_or_else(away)?.dims;
        if self.link.as_ref().is_none_or(|(of, _)| *of != dims) {
            self.link = None;
            let producer = ReconnectingProducer::open(instance, &ObservationHeader::new(dims)).map_err(ReconnectError::from)?;
            self.shared.producer_id.store(producer.id(), Ordering::Relaxed);
            self.link = Some((dims, producer));
        }
        Ok(dims)
    }

    fn send(&mut self, carver: &Carver<'_>, quality: &Quality, said: &Said) -> Result<(), PerceiveError> {
        let object = u64::from(carver.object);
        let header = ObservationHeader::of_grid(&CarvedGrid { object_id: object, ..CarvedGrid::from(&carver.grid).with_quality(quality) })?;
        let Some((_, producer)) = &mut self.link else {
            return Err(ReconnectError::from(OpenError::NotRunning { instance: self.arguments.instance.clone() }).into());
        };
        let mut loan = producer.loan()?;
        carve(carver, loan.voxels_mut())?;
        *loan.header_mut() = ObservationHeader {
            producer_id: loan.header().producer_id,
            continued_object_id: object,
            // Numbers of another's masks may mean another object in the next image.
            continues: u32::from(self.arguments.segmentation == Masks::Own),
            capture_ns: said.arrived_ns,
            sensor_stamp_ns: said.stamp_ns,
            frame_id: said.frame_id,
            ..header
        };
        loan.send()?;
        Ok(())
    }
}

/// Stamps and frame of an image, which all its grids share.
struct Said {
    arrived_ns: u64,
    stamp_ns: u64,
    frame_id: [u8; 32],
}
