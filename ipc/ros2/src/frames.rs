//! Frames whose answers are under way: the objects of one image are published together, under its own header.

use crate::answers::Answer;
use crate::messages::Header;
use beo_ipc::Percept;
use std::collections::{BTreeSet, VecDeque};
use std::time::{Duration, Instant};

/// Frames in the order of their images.
#[derive(Debug, Default)]
pub struct Frames {
    asked: VecDeque<Asked>,
}

#[derive(Debug)]
struct Asked {
    /// Tells it from the others; percepts repeat it.
    capture_ns: u64,
    header: Header,
    /// Objects without an answer yet.
    open: BTreeSet<u64>,
    answers: Vec<Answer>,
    since: Instant,
}

impl Frames {
    /// These objects of an image are being asked for.
    pub fn ask(&mut self, capture_ns: u64, header: Header, objects: impl IntoIterator<Item = u64>) {
        let open = objects.into_iter().collect();
        self.asked.push_back(Asked { capture_ns, header, open, answers: Vec::new(), since: Instant::now() });
    }

    /// An object has no answer: it was not sent.
    pub fn withdraw(&mut self, capture_ns: u64, object: u64) {
        if let Some(asked) = self.asked.iter_mut().find(|asked| asked.capture_ns == capture_ns) {
            asked.open.remove(&object);
        }
    }

    /// An object's percept came, with its answer where there is one. The same object of earlier images will have none: it was overtaken.
    pub fn close(&mut self, percept: &Percept, answer: Option<Answer>) {
        let Some(at) = self.asked.iter().position(|asked| asked.capture_ns == percept.capture_ns) else { return };
        for asked in self.asked.range_mut(..=at) {
            asked.open.remove(&percept.object_id);
        }
        if let Some(answer) = answer {
            self.asked[at].answers.push(answer);
        }
    }

    /// The next image of which nothing is to come any more, or for which nothing has come for as long as `patience`.
    pub fn take(&mut self, patience: Duration) -> Option<(Header, Vec<Answer>)> {
        let first = self.asked.front()?;
        if !first.open.is_empty() && first.since.elapsed() < patience {
            return None;
        }
        let Asked { header, mut answers, .. } = self.asked.pop_front()?;
        answers.sort_by_key(|answer| answer.percept.object_id);
        Some((header, answers))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(3600);

    fn header(name: &str) -> Header {
        Header { frame_id: name.into(), ..Header::default() }
    }

    fn answer(frames: &mut Frames, capture_ns: u64, object_id: u64) {
        let percept = Percept { capture_ns, object_id, ..Percept::EMPTY };
        frames.close(&percept, Some(Answer { percept, voxels: Vec::new() }));
    }

    fn taken(frames: &mut Frames, patience: Duration) -> Option<(String, Vec<u64>)> {
        let (header, answers) = frames.take(patience)?;
        Some((header.frame_id, answers.iter().map(|answer| answer.percept.object_id).collect()))
    }

    #[test]
    fn a_frame_is_whole_when_its_last_object_is_answered_withdrawn_or_refused() {
        let mut frames = Frames::default();
        frames.ask(1, header("a"), [7, 8, 9, 10]);
        answer(&mut frames, 1, 8);
        answer(&mut frames, 1, 7);
        frames.withdraw(1, 9);
        assert_eq!(taken(&mut frames, LONG), None);
        frames.close(&Percept { capture_ns: 1, object_id: 10, ..Percept::EMPTY }, None);
        assert_eq!(taken(&mut frames, LONG), Some(("a".into(), vec![7, 8])));
        assert_eq!(taken(&mut frames, LONG), None);
        answer(&mut frames, 99, 1);
    }

    #[test]
    fn frames_go_out_in_their_order_and_one_that_was_overtaken_waits_no_longer() {
        let mut frames = Frames::default();
        frames.ask(1, header("a"), [1, 2]);
        frames.ask(2, header("b"), [1]);
        frames.ask(3, header("empty"), []);
        answer(&mut frames, 1, 2);
        assert_eq!(taken(&mut frames, LONG), None);
        answer(&mut frames, 2, 1);
        assert_eq!(taken(&mut frames, LONG), Some(("a".into(), vec![2])));
        assert_eq!(taken(&mut frames, LONG), Some(("b".into(), vec![1])));
        assert_eq!(taken(&mut frames, LONG), Some(("empty".into(), vec![])));
        frames.ask(4, header("c"), [1]);
        assert_eq!(taken(&mut frames, Duration::ZERO), Some(("c".into(), vec![])), "patience is at its end");
    }
}
