//! Which machine a measurement was made on, and how idle it was.

use serde::Serialize;
use std::fs::read_to_string;

/// A load average above this, before anything was started, is not that of an idle machine.
const IDLE_LOAD: f64 = 0.5;
/// Other processes' share of the machine above which they disturb.
const IDLE_SHARE: f64 = 0.05;

/// The machine, as the kernel describes it. What cannot be read is empty or `None`.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// The processor's name.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Bytes of the largest cache; 0 where the kernel does not say.
    pub cache_bytes: usize,
    /// The kernel's name and release.
    pub kernel: String,
    /// How the clock rate is chosen, where the kernel says.
    pub governor: Option<String>,
    /// Processes that wanted to run, averaged over the minute before the start.
    pub load_average: Option<f64>,
}

impl Machine {
    /// This machine, now.
    pub fn describe() -> Self {
        let cpuinfo = read_to_string("/proc/cpuinfo").unwrap_or_default();
        let release = read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
        let governor = read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").ok();
        let load = read_to_string("/proc/loadavg").unwrap_or_default();
        Self {
            cpu: cpu_name(&cpuinfo).unwrap_or("unknown").to_owned(),
            cores: super::cores::usable().len(),
            cache_bytes: (0..4).filter_map(cache_bytes).max().unwrap_or(0),
            kernel: format!("Linux {}", release.trim()),
            governor: governor.map(|text| text.trim().to_owned()),
            load_average: load.split_whitespace().next().and_then(|text| text.parse().ok()),
        }
    }

    /// The reasons for doubt: who else used the machine.
    pub fn warnings(&self, others: Option<Others>) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(load) = self.load_average.filter(|load| *load > IDLE_LOAD) {
            warnings.push(format!("the machine was not idle at the start: load average {load:.2}"));
        }
        if let Some(others) = others {
            if others.processes > IDLE_SHARE {
                let percent = 100.0 * others.processes;
                warnings.push(format!("other processes used {percent:.0} % of the machine during the runs"));
            }
            if others.stolen > IDLE_SHARE {
                warnings.push(format!("the host took {:.0} % of the machine during the runs", 100.0 * others.stolen));
            }
        }
        warnings
    }
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { cpu, cores, cache_bytes, kernel, governor, load_average } = self;
        let governor = governor.as_deref().unwrap_or("not told");
        let load = load_average.map_or("not told".into(), |load| format!("{load:.2}"));
        write!(f, "{cpu}, {cores} cores, {} MB of cache, {kernel}, governor {governor}, load average {load}", cache_bytes >> 20)
    }
}

/// A line of this process's memory in /proc/self/status, such as `VmRSS:`, in bytes; `None` where the system does not tell.
pub fn process_memory(name: &str) -> Option<usize> {
    let status = read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.split_whitespace().next()?.parse::<usize>().ok()? << 10)
}

/// Of the first core's cache with this index.
fn cache_bytes(index: usize) -> Option<usize> {
    let size = read_to_string(format!("/sys/devices/system/cpu/cpu0/cache/index{index}/size")).ok()?;
    Some(size.trim().strip_suffix('K')?.parse::<usize>().ok()? << 10)
}

fn cpu_name(cpuinfo: &str) -> Option<&str> {
    let named = |line: &&str| line.starts_with("model name") || line.starts_with("Model");
    Some(cpuinfo.lines().find(named)?.split_once(':')?.1.trim())
}

/// Shares of the machine's processor time that went elsewhere, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Others {
    /// To processes that are neither this one nor its children.
    pub processes: f64,
    /// To other guests of the host.
    pub stolen: f64,
}

/// Processor time up to now, in ticks.
#[derive(Clone, Copy, Debug)]
pub struct Activity {
    total: u64,
    idle: u64,
    stolen: u64,
    own: u64,
}

impl Activity {
    /// Up to now; `None` where the kernel does not say.
    pub fn now() -> Option<Self> {
        Self::read(&read_to_string("/proc/stat").ok()?, &read_to_string("/proc/self/stat").ok()?)
    }

    /// From `/proc/stat` and `/proc/self/stat`.
    fn read(system: &str, process: &str) -> Option<Self> {
        let all = system.lines().next()?.strip_prefix("cpu ")?;
        // user, nice, system, idle, iowait, irq, softirq, steal; guests are in user.
        let ticks: Vec<u64> = all.split_whitespace().take(8).map_while(|text| text.parse().ok()).collect();
        // The name of the program is in parentheses and may hold anything; times are fields 14 to 17, those of ended children included.
        let own = process.rsplit_once(')')?.1.split_whitespace().skip(11).take(4).map_while(|text| text.parse::<u64>().ok()).sum();
        let [.., idle, waiting, _, _, stolen] = ticks[..] else { return None };
        Some(Self { total: ticks.iter().sum(), idle: idle + waiting, stolen, own })
    }

    /// The processor time that others used since `before`. Children count as others until they have ended and were waited for.
    pub fn others_since(&self, before: &Self) -> Others {
        let share = |ticks: u64| ticks as f64 / self.total.saturating_sub(before.total).max(1) as f64;
        let of = |field: fn(&Self) -> u64| field(self).saturating_sub(field(before));
        let busy = of(|a| a.total).saturating_sub(of(|a| a.idle) + of(|a| a.stolen));
        Others { processes: share(busy.saturating_sub(of(|a| a.own))), stolen: share(of(|a| a.stolen)) }
    }
}

/// The machine while something was measured on it; every report says it.
#[derive(Clone, Debug, Serialize)]
pub struct Circumstances {
    /// The machine.
    pub machine: Machine,
    /// The reasons for doubt.
    pub warnings: Vec<String>,
    /// Who else used the machine during the runs.
    pub others: Option<Others>,
}

/// Who uses the machine from now on.
pub struct Watch {
    machine: Machine,
    before: Option<Activity>,
}

impl Watch {
    /// From before anything is started.
    pub fn start() -> Self {
        Self { machine: Machine::describe(), before: Activity::now() }
    }

    /// The machine that is watched.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Up to now.
    pub fn end(self) -> Circumstances {
        let others = self.before.zip(Activity::now()).map(|(before, after)| after.others_since(&before));
        Circumstances { warnings: self.machine.warnings(others), machine: self.machine, others }
    }
}

impl Circumstances {
    /// The warnings as lines of a report.
    pub fn warning_lines(&self) -> String {
        self.warnings.iter().map(|warning| format!("warning: {warning}\n")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_used_is_what_was_busy_less_what_we_used() {
        let read = |system, process| Activity::read(system, process).unwrap();
        let before = read("cpu  100 0 50 800 50 0 0 0 0 0\ncpu0 1", "7 (a) b) S 1 1 1 0 -1 0 0 0 0 0 10 5 0 0 20");
        let after = read("cpu  400 0 150 1300 50 0 0 100 0 0\ncpu0 1", "7 (a) b) S 1 1 1 0 -1 0 0 0 0 0 60 25 100 30 20");
        // 1000 ticks: 500 idle, 100 stolen, 400 busy, of which 200 ours.
        assert_eq!(after.others_since(&before), Others { processes: 0.2, stolen: 0.1 });
        assert!(Activity::read("cpu  1 2", "").is_none());
        assert!(Activity::now().is_some());
    }

    #[test]
    fn a_busy_machine_is_warned_of() {
        let idle = Machine { load_average: Some(0.1), ..Machine::describe() };
        assert!(idle.warnings(Some(Others { processes: 0.01, stolen: 0.0 })).is_empty());
        let busy = Machine { load_average: Some(2.5), ..idle };
        let warnings = busy.warnings(Some(Others { processes: 0.4, stolen: 0.2 }));
        assert!(warnings.len() == 3 && warnings[0].contains("2.50") && warnings[1].contains("40 %"), "{warnings:?}");
    }

    #[test]
    fn the_processor_is_named() {
        assert_eq!(cpu_name("processor : 0\nmodel name\t: A CPU @ 2 GHz\n"), Some("A CPU @ 2 GHz"));
        assert_eq!(cpu_name(""), None);
        let machine = Watch::start().end().machine;
        assert!(machine.cores >= 1);
        let text = Machine { cache_bytes: 32 << 20, load_average: Some(0.25), ..machine.clone() }.to_string();
        assert!(text.starts_with(&machine.cpu) && text.contains("32 MB of cache") && text.ends_with("load average 0.25"), "{text}");
    }
}
