//! The work of the producer's process: send what is due, count, and stay until all was answered.

use super::Scene;
use super::load::{Clock, Load, Monotonic, drive};
use super::record::to_stamp;
use super::{CameraRate, Grids, LatencyError, Pose, Wake, objects_on_table};
use beo_camera::{GridOptions, Observer, carve};
use beo_core::grid::Dims;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{CarvedGrid, InstanceName, ObservationHeader, Producer, Status, Subscriber, SubscriberOptions, View};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long the producer's process waits for the daemon to be there.
pub(super) const OPEN: Duration = Duration::from_secs(10);
/// An answer that has not come after this long will not come.
const ANSWER_NS: u64 = 10_000_000_000;
/// The longest wait for the last answers at the end of a run; beyond, something is broken.
const SETTLE: Duration = Duration::from_secs(60);

/// The settings of a producer; the grids follow them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ProducerPlan {
    /// The daemon's instance.
    pub instance: String,
    /// In what rhythm.
    pub load: Load,
    /// The scene and the rate of [`Load::Camera`].
    pub camera: CameraRate,
    /// The prior knowledge of the pose.
    pub pose: Pose,
    /// How answers are waited for where they set the pace.
    pub wake: Wake,
    /// The observations that are sent first and not measured.
    pub warm_up_s: f64,
    /// Length of the measurement.
    pub seconds: f64,
    /// Size of the grids.
    pub dims: [u32; 3],
    /// How many shapes the grids show.
    pub shapes: usize,
}

/// The outcome, as producer and daemon counted it.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Sent {
    /// Observations sent.
    pub sent: u64,
    /// Of these, during the warm-up.
    pub warm_up: u64,
    /// Observations that the daemon took.
    pub received: u64,
    /// Of these, answered.
    pub answered: u64,
    /// Of these, replaced by a newer one of the same object while they waited.
    pub overtaken: u64,
    /// Of these, refused.
    pub refused: u64,
}

/// Sends as planned, until done or `stop` is set.
///
/// # Errors
/// The errors of the channels, and one if the daemon does not come to rest.
pub fn produce(plan: &ProducerPlan, grids: &Grids, stop: &AtomicBool) -> Result<Sent, LatencyError> {
    let instance = InstanceName::new(&plan.instance)?;
    let mut template = ObservationHeader::new(plan.dims);
    template.pose_search = plan.pose.search().code();
    template.view = View::TopDown.code();
    let producer = Producer::open_within(&instance, &template, OPEN)?;
    let mut warm_up = 0;
    let mut send = |object: u64, frame: u64, due_ns: u64, counted: bool| -> Result<u64, LatencyError> {
        let mut loan = producer.loan()?;
        loan.voxels_mut().copy_from_slice(grids.of(plan.pose, object, frame));
        let header = loan.header_mut();
        header.object_id = object + 1;
        (header.continues, header.continued_object_id) = (u32::from(plan.pose == Pose::Track), object + 1);
        // What the percept repeats is what the reader knows: when it was due, and whether it counts.
        (header.capture_ns, header.sensor_stamp_ns) = (due_ns, to_stamp(0, counted));
        warm_up += u64::from(!counted);
        Ok(loan.send()?.sequence)
    };
    let [x, y, z] = plan.dims.map(|side| side as usize);
    let options = GridOptions::new(Dims::new(x, y, z)?.into());
    // As drivers do, it keeps what lasts from frame to frame.
    let mut scene = (plan.load == Load::Camera).then(|| (objects_on_table(plan.camera.objects), Observer::new(options)));
    let mut in_warm_up = 0;
    let going = || !stop.load(Ordering::Relaxed);
    let start_ns = monotonic_ns();
    let counted_from_ns = start_ns + (plan.warm_up_s * 1e9) as u64;
    if let Some(interval) = plan.load.interval(plan.camera) {
        let frames = |seconds: f64| (seconds / interval.as_secs_f64()).round() as u64;
        let unmeasured = frames(plan.warm_up_s);
        drive(&mut Monotonic, start_ns, interval, unmeasured + frames(plan.seconds).max(1), |_, frame, due_ns| {
            let counted = frame >= unmeasured;
            match &mut scene {
                Some((captured, observer)) => {
                    let sent = see(&producer, captured, observer, plan.pose, due_ns, counted)?;
                    in_warm_up += if counted { 0 } else { sent };
                }
                None => {
                    for object in 0..plan.load.objects(plan.camera) {
                        send(object, frame, due_ns, counted)?;
                    }
                }
            }
            Ok::<_, LatencyError>(going())
        })?;
    } else {
        let subscriber = Subscriber::open_within(&instance, &SubscriberOptions::default(), OPEN)?;
        let end_ns = counted_from_ns + (plan.seconds * 1e9) as u64;
        let mut frame = 0;
        while going() && Monotonic.now() < end_ns {
            let due_ns = Monotonic.now();
            let sequence = send(0, frame, due_ns, due_ns >= counted_from_ns)?;
            wait_for(&subscriber, sequence, plan.wake, due_ns + ANSWER_NS)?;
            frame += 1;
        }
    }
    let counts = settled(&instance, stop)?;
    let Status { received, answered, dropped: overtaken, refused, .. } = counts;
    Ok(Sent { sent: producer.sent(), warm_up: warm_up + in_warm_up, received, answered, overtaken, refused })
}

/// Sends the objects of a frame, each carved into its place in shared memory; how many.
fn see(
    producer: &Producer,
    captured: &Scene,
    observer: &mut Observer,
    pose: Pose,
    due_ns: u64,
    counted: bool,
) -> Result<u64, LatencyError> {
    let laid = observer.observe(&captured.frame());
    let laid_ns = monotonic_ns();
    let mut sent = 0;
    for carver in laid.carvers().filter_map(|(_, carver)| carver.ok()) {
        let mut loan = producer.loan()?;
        carve(&carver, loan.voxels_mut())?;
        let template = *loan.header();
        *loan.header_mut() = ObservationHeader {
            producer_id: template.producer_id,
            pose_search: template.pose_search,
            tasks: template.tasks,
            capture_ns: due_ns,
            sensor_stamp_ns: to_stamp(laid_ns, counted),
            continues: u32::from(pose == Pose::Track),
            continued_object_id: carver.object.into(),
            ..ObservationHeader::of_grid(&CarvedGrid {
                object_id: carver.object.into(),
                known_side_m: observer.options().placement.known_side_m.unwrap_or(0.0),
                ..CarvedGrid::from(&carver.grid)
            })?
        };
        loan.send()?;
        sent += 1;
    }
    Ok(sent)
}

/// Waits until the percept with this number was read. One that does not come is missing in the counts.
fn wait_for(subscriber: &Subscriber, sequence: u64, wake: Wake, until_ns: u64) -> Result<(), LatencyError> {
    while monotonic_ns() < until_ns {
        while let Some(percept) = subscriber.take_percept()? {
            if percept.sequence >= sequence {
                return Ok(());
            }
        }
        match wake {
            Wake::Event => drop(subscriber.wait(Duration::from_millis(50))?),
            Wake::Polling => std::thread::yield_now(),
        }
    }
    Ok(())
}

/// The daemon's counters once nothing waits any more: two heartbeats after now that say the same.
fn settled(instance: &InstanceName, stop: &AtomicBool) -> Result<Status, LatencyError> {
    let subscriber = Subscriber::open_within(instance, &SubscriberOptions::default(), OPEN)?;
    let start_ns = monotonic_ns();
    let mut last: Option<Status> = None;
    while monotonic_ns() < start_ns + SETTLE.as_nanos() as u64 && !stop.load(Ordering::Relaxed) {
        if let Some(status) = subscriber.status()?.filter(|status| status.heartbeat_ns > start_ns) {
            let at_rest = status.received == status.answered + status.dropped + status.refused;
            match last {
                Some(last) if last.heartbeat_ns == status.heartbeat_ns => {}
                Some(last) if at_rest && last.received == status.received => return Ok(status),
                _ => last = Some(status),
            }
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    if stop.load(Ordering::Relaxed) { Err(LatencyError::Interrupted) } else { Err(LatencyError::Unsettled(SETTLE)) }
}
