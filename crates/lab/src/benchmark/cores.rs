//! Which process of a measurement runs on which core.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::Serialize;

/// Cores that the daemon gets at least, before each client gets one of its own.
const DAEMON: usize = 2;

/// The cores that this thread may use.
pub fn usable() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
    (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()
}

/// Runs `work` with this thread on `cores`, on which whatever it starts stays.
///
/// # Errors
/// The system's error if it does not allow these cores, and the result of `work`.
pub fn pin<T, E: From<std::io::Error>>(cores: &[usize], work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
    let before = sched_getaffinity(None).map_err(std::io::Error::from)?;
    let mut set = CpuSet::new();
    cores.iter().for_each(|core| set.set(*core));
    sched_setaffinity(None, &set).map_err(std::io::Error::from)?;
    let done = work();
    sched_setaffinity(None, &before).map_err(std::io::Error::from)?;
    done
}

/// Cores of each process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cores {
    /// Of the daemon.
    pub daemon: Vec<usize>,
    /// Of the producer.
    pub producer: Vec<usize>,
    /// Of each reader.
    pub readers: Vec<Vec<usize>>,
}

impl Cores {
    /// A core for each client and the rest, at least two, for the daemon; where they do not suffice the clients share: the last core, apart
    /// from the daemon, of three or more; of two, one for the producer and one for the readers, with the daemon on both.
    pub fn plan(usable: &[usize], readers: usize) -> Self {
        let n = usable.len();
        let clients = readers + 1;
        if n >= DAEMON + clients {
            let (daemon, own) = usable.split_at(n - clients);
            return Self { daemon: daemon.to_vec(), producer: vec![own[0]], readers: own[1..].iter().map(|core| vec![*core]).collect() };
        }
        let last = usable.last().copied().into_iter().collect::<Vec<_>>();
        if n > DAEMON {
            return Self { daemon: usable[..n - 1].to_vec(), producer: last.clone(), readers: vec![last; readers] };
        }
        Self { daemon: usable.to_vec(), producer: usable.iter().take(1).copied().collect(), readers: vec![last; readers] }
    }

    /// Which processes share a core, in words; empty if none do.
    pub fn shared(&self) -> Vec<String> {
        let named = |cores: &[usize], name: String| cores.iter().map(move |core| (*core, name.clone())).collect::<Vec<_>>();
        let mut users: Vec<(usize, String)> = named(&self.daemon, "daemon".into());
        users.extend(named(&self.producer, "producer".into()));
        for (i, cores) in self.readers.iter().enumerate() {
            users.extend(named(cores, format!("reader {}", i + 1)));
        }
        let mut cores: Vec<usize> = users.iter().map(|(core, _)| *core).collect();
        cores.sort_unstable();
        cores.dedup();
        let on = |core: usize| users.iter().filter(move |(c, _)| *c == core).map(|(_, name)| name.as_str()).collect::<Vec<_>>();
        cores
            .into_iter()
            .map(|core| (core, on(core)))
            .filter(|(_, names)| names.len() > 1)
            .map(|(core, names)| format!("core {core} is shared by {}", names.join(", ")))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_get_cores_of_their_own_where_there_are_enough() {
        let plan = Cores::plan(&[0, 1, 2, 3, 4], 2);
        assert_eq!(plan, Cores { daemon: vec![0, 1], producer: vec![2], readers: vec![vec![3], vec![4]] });
        assert!(plan.shared().is_empty());
        let plan = Cores::plan(&[4, 5, 6], 1);
        assert_eq!(plan, Cores { daemon: vec![4, 5], producer: vec![6], readers: vec![vec![6]] });
        assert_eq!(plan.shared(), ["core 6 is shared by producer, reader 1"]);
        let plan = Cores::plan(&[0, 1], 1);
        assert_eq!(plan, Cores { daemon: vec![0, 1], producer: vec![0], readers: vec![vec![1]] });
        assert_eq!(plan.shared(), ["core 0 is shared by daemon, producer", "core 1 is shared by daemon, reader 1"]);
        assert_eq!(Cores::plan(&[3], 1), Cores { daemon: vec![3], producer: vec![3], readers: vec![vec![3]] });
    }

    #[test]
    fn what_is_started_stays_on_its_cores_and_we_go_back() {
        let before = usable();
        let last = *before.last().unwrap();
        let inside = pin(&[last], || Ok::<_, std::io::Error>(usable())).unwrap();
        assert_eq!((inside, usable()), (vec![last], before));
        assert!(pin(&[], || Ok::<_, std::io::Error>(())).is_err());
    }
}
