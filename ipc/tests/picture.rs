//! Pictures of frames, from a camera to those who look.

mod waiting;

use beo_ipc::{InstanceName, OpenError, Picture, PictureHeader, PictureReader, PictureSender, ReceiveError, text};
use iceoryx2::prelude::*;
use waiting::eventually;

fn instance(test: &str) -> InstanceName {
    InstanceName::new(&format!("picture-{test}-{}", std::process::id())).unwrap()
}

fn watched(sender: &mut PictureSender) {
    eventually("somebody looks", || sender.is_watched().unwrap().then_some(()));
}

fn taken(reader: &PictureReader) -> Picture {
    eventually("a picture", || reader.take().unwrap())
}

/// A picture of one colour.
fn plain(width: u32, height: u32, value: u8) -> (PictureHeader, Vec<u8>) {
    let frame_id = text::to_field("camera");
    let header = PictureHeader { width, height, producer_id: 7, capture_ns: 5, sensor_stamp_ns: 6, frame_id, ..PictureHeader::default() };
    (header, vec![value; header.bytes()])
}

#[test]
fn pictures_are_drawn_only_while_somebody_looks_and_the_newest_is_seen() {
    let instance = instance("look");
    let mut sender = PictureSender::new(&instance);
    assert!(!sender.is_watched().unwrap());
    let (header, pixels) = plain(4, 3, 1);
    assert_eq!(sender.send(&header, &pixels).unwrap(), 0, "nobody looks");

    let reader = PictureReader::open(&instance).unwrap();
    watched(&mut sender);
    for value in 1..=3 {
        let (header, pixels) = plain(4, 3, value);
        assert_eq!(sender.send(&header, &pixels).unwrap(), 1);
    }
    let newest = taken(&reader);
    assert_eq!((newest.header(), newest.pixels().unwrap()), (&header, &[3; 36][..]));
    assert!(reader.take().unwrap().is_none());

    // A larger one, while one is held.
    let (larger, pixels) = plain(640, 480, 9);
    sender.send(&larger, &pixels).unwrap();
    assert_eq!(taken(&reader).pixels().unwrap(), pixels);
    assert_eq!(newest.pixels().unwrap(), [3; 36]);

    drop((newest, reader));
    assert!(!sender.is_watched().unwrap(), "nobody looks any more");
    let again = PictureReader::open(&instance).unwrap();
    watched(&mut sender);
    sender.send(&header, &[5; 36]).unwrap();
    assert_eq!(taken(&again).pixels().unwrap(), [5; 36]);
}

#[test]
fn several_look_and_one_too_many_is_told_so() {
    let instance = instance("several");
    let readers: Vec<PictureReader> = (0..4).map(|_| PictureReader::open(&instance).unwrap()).collect();
    let refused = PictureReader::open(&instance).unwrap_err();
    assert!(matches!(refused, OpenError::Full { .. }), "{refused}");
    let mut senders = [PictureSender::new(&instance), PictureSender::new(&instance)];
    for (sender, value) in senders.iter_mut().zip([10, 20]) {
        watched(sender);
        let (header, pixels) = plain(2, 2, value);
        assert_eq!(sender.send(&header, &pixels).unwrap(), 4);
    }
    for reader in &readers {
        let mut values = [taken(reader), taken(reader)].map(|picture| picture.pixels().unwrap()[0]);
        values.sort_unstable();
        assert_eq!(values, [10, 20]);
    }
}

/// Whoever writes past this library can send anything.
#[test]
fn a_picture_that_contradicts_its_header_is_refused() {
    let instance = instance("hostile");
    let reader = PictureReader::open(&instance).unwrap();
    let config = beo_ipc::node::config();
    let node = NodeBuilder::new().config(&config).create::<ipc_threadsafe::Service>().unwrap();
    let name = instance.picture().as_str().try_into().unwrap();
    let service = node.service_builder(&name).publish_subscribe::<[u8]>().user_header::<PictureHeader>().open().unwrap();
    let publisher = service.publisher_builder().initial_max_slice_len(64).create().unwrap();
    let send = |header: PictureHeader, bytes: usize| {
        let mut sample = publisher.loan_slice(bytes).unwrap();
        *sample.user_header_mut() = header;
        sample.send().unwrap();
        taken(&reader)
    };
    let (header, _) = plain(4, 3, 0);
    for (width, height, bytes) in [(4, 3, 35), (4, 3, 37), (0, 3, 1), (u32::MAX, u32::MAX, 64)] {
        let picture = send(PictureHeader { width, height, ..header }, bytes);
        let broken = picture.pixels().unwrap_err();
        assert!(matches!(broken, ReceiveError::Broken { found, .. } if found == bytes), "{width} {height} {bytes}: {broken}");
    }
    let other = send(PictureHeader { abi_version: 9, ..header }, 36);
    assert!(other.pixels().unwrap_err().to_string().contains("version 9"));
    assert_eq!(send(header, 36).pixels().unwrap(), [0; 36]);
}
