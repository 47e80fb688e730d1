//! A robot's process: prints class and latency of what the daemon perceives.
//!
//!     cargo run --release --example listen -- [INSTANCE] [COUNT]
//!
//! It needs a running daemon, and something that observes: `beo observe`, or the example `camera`.

use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::from_field;
use beo_ipc::{InstanceName, Subscriber, SubscriberOptions};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = InstanceName::new(&arguments.next().unwrap_or("default".into()))?;
    let count: u64 = arguments.next().map_or(Ok(u64::MAX), |text| text.parse())?;

    let subscriber = Subscriber::open_within(&instance, &SubscriberOptions::default(), Duration::from_secs(10))?;
    let mut heard = 0;
    while heard < count {
        subscriber.wait(Duration::from_millis(500))?;
        while let Some(percept) = subscriber.take_percept()? {
            let latency_us = monotonic_ns().saturating_sub(percept.capture_ns) / 1000;
            let status = subscriber.status()?;
            match status.as_ref().and_then(|s| s.class_names.get(percept.class_index as usize)) {
                Some(name) => {
                    let probability = 100.0 * percept.posterior[percept.class_index as usize];
                    println!("#{} {} {probability:.1} %, {latency_us} us", percept.sequence, from_field(name));
                }
                None => println!("#{} {}", percept.sequence, from_field(&percept.explanation)),
            }
            heard += 1;
        }
        subscriber.maintain();
    }
    Ok(())
}
