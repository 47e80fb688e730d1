//! The main job: a producer writes into shared memory, the daemon answers, a watcher reads.

use crate::client::{Client, DIMS, block, explanation};
use crate::harness::{RESOLUTION, Running, beo, instance, model, run, segments, serve, shape, text};
use beo_ipc::{Percept, PerceptStatus, PoseSearch, Unit, View, cut, tasks};
use beo_shapes::furniture;
use rustix::process::Signal;
use serde_json::Value;

#[test]
fn observe_serve_and_watch_name_made_up_furniture_and_leave_nothing_behind() {
    let name = instance();
    let mut daemon = serve(&name);
    let count = furniture::CLASSES.len().to_string();
    let mut watcher = Running::start(beo(["watch", "--json", "--instance", &name, "--count", &count]));
    assert!(watcher.message().starts_with("watching"));
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<_> = furniture::CLASSES.iter().map(|class| shape(folder.path(), class, 1001)).collect();

    let mut lines = Vec::new();
    // Two completions are kept for a reader: however late the watcher is, it loses none of two.
    for (index, pair) in files.chunks(2).enumerate() {
        let arguments = ["observe", "--instance", &name, "--rate", "200"].map(std::ffi::OsString::from);
        let output = run(arguments.into_iter().chain(pair.iter().map(|f| f.clone().into_os_string())));
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert_eq!(text(&output.stdout), "sent 2 observations, 2 answered");
        lines.extend([(); 2].map(|()| (2 * index, watcher.line())));
    }
    let mut right = 0;
    for (before, line) in lines {
        let line: Value = serde_json::from_str(&line).unwrap();
        let sequence = before + line["sequence"].as_u64().unwrap() as usize;
        let posterior = line["posterior"].as_object().unwrap();
        assert_eq!(posterior.len(), 10);
        assert!((posterior.values().map(|p| p.as_f64().unwrap()).sum::<f64>() - 1.0).abs() < 1e-5);
        assert!(line["latency_us"].as_f64().unwrap() > 0.0);
        assert_eq!(line["completion"]["dims"], serde_json::json!(DIMS));
        assert!(line["completion"]["filled"].as_u64().unwrap() > 0);
        let class = line["class"].as_str().unwrap();
        assert!(posterior.values().all(|p| p.as_f64() <= posterior[class].as_f64()));
        right += usize::from(class == furniture::CLASSES[sequence - 1]);

        // The daemon's answer is that of `perceive` without a daemon.
        let alone = run(["perceive".as_ref(), "--json".as_ref(), "--model".as_ref(), model().as_os_str(), files[sequence - 1].as_os_str()]);
        let alone: Value = serde_json::from_str(&text(&alone.stdout)).unwrap();
        assert_eq!(alone["class"], line["class"]);
        for (name, p) in posterior {
            assert!((p.as_f64().unwrap() - alone["posterior"][name].as_f64().unwrap()).abs() < 1e-5);
        }
        let difference = alone["completion"]["filled"].as_i64().unwrap() - line["completion"]["filled"].as_i64().unwrap();
        assert!(difference.abs() <= 3, "the bytes of the completion round the probability: {difference}");
    }
    assert!(right >= 8, "{right} of 10 made-up pieces were named");
    assert!(watcher.wait().success());

    let mapped = segments(daemon.id());
    assert!(!mapped.is_empty());
    daemon.signal(Signal::INT);
    assert!(daemon.wait().success());
    let left: Vec<_> = mapped.iter().filter(|path| path.exists()).collect();
    assert!(left.is_empty(), "left in shared memory: {left:?}");
}

#[test]
fn sigterm_ends_the_daemon_cleanly_too() {
    let mut daemon = serve(&instance());
    let mapped = segments(daemon.id());
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    assert!(mapped.iter().all(|path| !path.exists()));
}

#[test]
fn a_second_daemon_of_the_same_name_is_refused_in_one_line() {
    let name = instance();
    let _first = serve(&name);
    let second = run(["serve".as_ref(), "--instance".as_ref(), name.as_ref(), "--model".as_ref(), model().as_os_str()]);
    assert_eq!(second.status.code(), Some(1));
    let message = text(&second.stderr);
    assert!(message.lines().count() == 1 && message.contains(&name), "{message}");
}

#[test]
fn what_cannot_be_answered_is_refused_with_a_reason_and_the_next_is_answered() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    let refused = |percept: Percept, status: PerceptStatus, reason: &str| {
        assert_eq!(percept.status, status.code(), "{}", explanation(&percept));
        assert!(explanation(&percept).contains(reason), "{}", explanation(&percept));
        assert_eq!(percept.class_index, beo_ipc::NO_CLASS);
    };
    refused(client.ask(|_, voxels| voxels[77] = 9), PerceptStatus::BadVoxel, "voxel 77 is 9");
    refused(client.ask(|header, _| header.dims = [30; 3]), PerceptStatus::BadDims, "30");
    refused(client.ask(|header, _| header.orientation = [f64::NAN; 4]), PerceptStatus::BadHeader, "orientation");
    refused(client.ask(|header, _| header.abi_version = 7), PerceptStatus::UnknownVersion, "7");
    refused(client.ask(|header, _| header.rotation_prior_concentration = -1.0), PerceptStatus::BadHeader, "rotation_prior_concentration");
    refused(client.ask(|header, _| header.pose_search = 9), PerceptStatus::BadHeader, "pose_search");
    refused(client.ask(|header, _| header.cut = 4), PerceptStatus::BadHeader, "cut");
    refused(client.ask(|header, _| header.unit = 2), PerceptStatus::BadHeader, "unit");
    refused(client.ask(|header, _| header.share_far = f32::NAN), PerceptStatus::BadHeader, "share_far");
    refused(client.ask(|header, _| header.reserved[0] = 1), PerceptStatus::BadHeader, "reserved");

    let percept = client.ask(|header, voxels| {
        header.object_id = 42;
        header.sensor_stamp_ns = 7;
        block(voxels);
    });
    assert_eq!(percept.status, 0, "{}", explanation(&percept));
    assert_eq!((percept.object_id, percept.sensor_stamp_ns, percept.producer_id), (42, 7, client.producer.id()));
    let stamps = [
        percept.capture_ns,
        percept.written_ns,
        percept.received_ns,
        percept.projected_ns,
        percept.classified_ns,
        percept.posed_ns,
        percept.completed_ns,
        percept.published_ns,
    ];
    assert!(stamps.windows(2).all(|pair| pair[0] <= pair[1]) && stamps[0] > 0, "{stamps:?}");
    assert_eq!(percept.hypothesis_count, 1);
    assert_eq!(percept.hypotheses[0].rotation_object_to_grid, [0.0, 0.0, 0.0, 1.0]);
}

#[test]
fn completions_keep_what_was_seen_and_predict_the_rest() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    let mut sent = vec![0; RESOLUTION.pow(3)];
    block(&mut sent);
    let percept = client.ask(|_, voxels| voxels.copy_from_slice(&sent));
    assert_ne!(percept.tasks & tasks::COMPLETION, 0);
    let completion = client.subscriber.take_completion().unwrap().expect("it was sent before its percept");
    assert_eq!((completion.header().sequence, completion.header().class_index), (percept.sequence, percept.class_index));
    let mut hidden = 0;
    for (voxel, code) in sent.iter().enumerate() {
        let (p, sd) = (completion.occupancy()[voxel], completion.deviation()[voxel]);
        match code {
            0 => assert_eq!((p, sd), (0, 0)),
            1 => assert_eq!((p, sd), (255, 0)),
            _ => hidden += usize::from(p > 0 && p < 255),
        }
    }
    assert!(hidden > 0, "hidden voxels are probabilities");

    let percept = client.ask(|header, voxels| {
        header.tasks = tasks::CLASS;
        block(voxels);
    });
    assert_eq!(percept.tasks & tasks::COMPLETION, 0);
    assert!(client.subscriber.take_completion().unwrap().is_none(), "none was asked for");
}

/// It was answered by the prior once, as the first class, with a completion.
#[test]
fn an_observation_without_an_object_has_a_status_and_no_class() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    for code in [255, 0] {
        let percept = client.ask(|header, voxels| {
            (header.tasks, header.cut, header.unit) = (tasks::ALL, cut::OCCLUDER, Unit::Metres.code());
            voxels.fill(code);
        });
        assert_eq!(percept.status, PerceptStatus::NothingSeen.code(), "{}", explanation(&percept));
        assert!(explanation(&percept).contains("no voxel is filled"));
        assert_eq!((percept.class_index, percept.class_count, percept.hypothesis_count), (beo_ipc::NO_CLASS, 0, 0));
        assert_eq!((percept.posterior, percept.object_extent_m), ([0.0; 64], [0.0; 3]));
        assert_eq!((percept.tasks, percept.cut, percept.unit), (0, cut::OCCLUDER, Unit::Metres.code()));
        assert!(client.subscriber.take_completion().unwrap().is_none());
    }
    let seen = client.ask(|_, voxels| block(voxels));
    assert_eq!((seen.status, seen.answer_number), (0, 3), "percepts of all kinds are counted");
    let status = client.status(|status| status.received == 3 && status.waiting() == 0);
    assert_eq!((status.answered, status.refused, status.nothing_seen, status.answer_number), (1, 2, 2, 3));
}

#[test]
fn the_status_names_the_classes_and_counts() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    client.ask(|_, voxels| block(voxels));
    client.ask(|_, voxels| voxels[0] = 3);
    let status = client.status(|s| s.received == 2 && s.latency_p50_ns > 0);
    assert_eq!((status.answered, status.refused, status.dropped), (1, 1, 0));
    assert_eq!(status.answered_none, 0, "a model that cannot tell says of nothing that it is none of its classes");
    assert_eq!(status.class_names().collect::<Vec<_>>(), furniture::CLASSES);
    assert_eq!((status.dims, status.model_id != 0, status.heartbeat_ns > 0), (DIMS, true, true));
}

/// Of an object that is followed, a hypothesis is as probable as its class, given all frames, lets it be.
#[test]
fn hypotheses_of_a_followed_object_have_the_probability_of_their_filtered_class() {
    let name = instance();
    let _daemon = serve(&name);
    let client = Client::new(&name);
    let mut unsure = 0;
    for frame in 0..6 {
        let percept = client.ask(|header, voxels| {
            header.pose_search = PoseSearch::Yaw.code();
            header.view = View::Camera.code();
            header.sensor_position_m = [-30.0, 0.0, 40.0];
            (header.object_id, header.continued_object_id, header.continues) = (7, 7, 1);
            block(voxels);
        });
        assert_eq!((percept.status, percept.filtered), (0, u32::from(frame > 0)), "{}", explanation(&percept));
        for (class, probability) in percept.posterior.iter().enumerate().take(percept.class_count as usize) {
            let of_class = percept.hypotheses.iter().take(percept.hypothesis_count as usize).filter(|h| h.class_index == class as u32);
            let sum: f32 = of_class.map(|h| h.probability).sum();
            assert!(sum <= probability + 1e-4, "frame {frame}, class {class}: hypotheses {sum}, posterior {probability}");
        }
        unsure += u32::from(frame > 0 && percept.posterior.iter().all(|p| *p < 0.99));
    }
    assert!(unsure > 0, "where one class is certain, nothing was tested");
}
