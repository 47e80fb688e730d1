//! A robot's process: prints class, pose, box and latency of what the daemon perceives.
//!
//!     cargo run --release --example listen -- [INSTANCE] [COUNT]
//!
//! INSTANCE: of the daemon (default); COUNT: percepts to print (without end).

use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::from_field;
use beo_ipc::{InstanceName, Percept, PerceptStatus, ReconnectError, ReconnectingSubscriber, SubscriberOptions, Waited};
use std::time::Duration;

/// The names of the classes come with the daemon's status; the first one is there within about a second.
fn class_name(percept: &Percept, subscriber: &mut ReconnectingSubscriber) -> Result<String, ReconnectError> {
    let status = loop {
        match subscriber.status()? {
            Some(status) => break status,
            None => subscriber.wait(Some(Duration::from_millis(50)))?,
        };
    };
    let name = status.class_names().nth(percept.class_index as usize).filter(|_| status.model_id == percept.model_id);
    Ok(name.unwrap_or("?").to_owned())
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

fn print(percept: &Percept, subscriber: &mut ReconnectingSubscriber) -> Result<(), ReconnectError> {
    let (number, latency_us) = (percept.sequence, monotonic_ns().saturating_sub(percept.capture_ns) as f64 / 1e3);
    let probability = match percept.posterior.get(percept.class_index as usize) {
        Some(probability) if percept.status == PerceptStatus::Ok.code() => 100.0 * probability,
        _ => {
            println!("#{number} refused: {}", from_field(&percept.explanation));
            return Ok(());
        }
    };
    let pose = match percept.hypotheses.first().filter(|_| percept.hypothesis_count > 0) {
        Some(best) => {
            let ([x, y, z, w], spread) = (best.rotation_object_to_grid, percept.rotation_spread_rad.to_degrees());
            format!("rotation ({x:.3}, {y:.3}, {z:.3}, {w:.3}), spread {spread:.1} deg, ")
        }
        None => String::new(),
    };
    let found_box = found_box(percept).map_or(String::new(), |text| text + ", ");
    println!("#{number} {} {probability:.1} %, {pose}{found_box}{latency_us:.0} us", class_name(percept, subscriber)?);
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = InstanceName::new(&arguments.next().unwrap_or("default".into()))?;
    let count: u64 = arguments.next().map_or(Ok(u64::MAX), |text| text.parse())?;

    let mut subscriber = ReconnectingSubscriber::open_within(&instance, &SubscriberOptions::default(), Duration::from_secs(10))?;
    eprintln!("listening");
    let (mut heard, mut told) = (0, 0);
    while heard < count {
        // A timeout, or a daemon that is away, is no reason to end: waiting also connects to the next daemon.
        if subscriber.wait(Some(Duration::from_millis(500)))? == Waited::NotRunning {
            eprintln!("waiting for the daemon");
        }
        while heard < count
            && let Some(percept) = subscriber.take_percept()?
        {
            print(&percept, &mut subscriber)?;
            heard += 1;
        }
        // More came than are kept for a reader.
        let missed = subscriber.missed();
        if missed > told {
            eprintln!("missed {} percepts", missed - told);
            told = missed;
        }
    }
    Ok(())
}
