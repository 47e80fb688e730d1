//! Other processes of this program: started, listened to, asked to end, and killed by their id if they do not.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// A process that nobody needs any more is given this long to end before it is killed.
const GRACE: Duration = Duration::from_secs(5);
/// Time between two looks at whether it has ended.
const LOOK: Duration = Duration::from_millis(10);

/// A process did not do what it was started for.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// The system refused.
    #[error("cannot start {name}: {source}")]
    Start {
        /// The program that was to be started.
        name: &'static str,
        /// The operating system's words.
        source: std::io::Error,
    },
    /// Input or output was taken before, or never asked for.
    #[error("{0} has no such stream")]
    Stream(&'static str),
    /// It cannot be waited for.
    #[error("cannot wait for {name}: {source}")]
    Wait {
        /// Which.
        name: &'static str,
        /// The operating system's words.
        source: std::io::Error,
    },
    /// It failed.
    #[error("{name} ended with {status}; its own message stands above")]
    Failed {
        /// Which.
        name: &'static str,
        /// How it ended.
        status: std::process::ExitStatus,
    },
    /// It hangs.
    #[error("{name} did not end within {patience:?}")]
    Hung {
        /// Which.
        name: &'static str,
        /// How long it was waited for.
        patience: Duration,
    },
}

/// This program once more: nothing to read, its output for us, its messages where ours go.
pub fn this_program() -> std::io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::inherit());
    Ok(command)
}

/// A running process, ended when dropped.
pub struct Process {
    child: Child,
    name: &'static str,
}

impl Process {
    /// Starts a process; `name` is for messages.
    ///
    /// # Errors
    /// [`ProcessError::Start`].
    pub fn start(name: &'static str, command: &mut Command) -> Result<Self, ProcessError> {
        let child = command.spawn().map_err(|source| ProcessError::Start { name, source })?;
        Ok(Self { child, name })
    }

    /// The name in messages.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Its standard input, once.
    ///
    /// # Errors
    /// [`ProcessError::Stream`] if it is not piped or was taken before; so for the other streams.
    pub fn input(&mut self) -> Result<ChildStdin, ProcessError> {
        self.child.stdin.take().ok_or(ProcessError::Stream(self.name))
    }

    /// Its standard output, once.
    ///
    /// # Errors
    /// [`ProcessError::Stream`].
    pub fn output(&mut self) -> Result<ChildStdout, ProcessError> {
        self.child.stdout.take().ok_or(ProcessError::Stream(self.name))
    }

    /// Its messages, once.
    ///
    /// # Errors
    /// [`ProcessError::Stream`].
    pub fn messages(&mut self) -> Result<impl Read + use<>, ProcessError> {
        self.child.stderr.take().ok_or(ProcessError::Stream(self.name))
    }

    /// Its standard output, line by line, from a thread: a process that hangs does not hang whoever listens.
    ///
    /// # Errors
    /// [`ProcessError::Stream`].
    pub fn lines(&mut self) -> Result<Receiver<String>, ProcessError> {
        let output = BufReader::new(self.output()?);
        let (sender, receiver) = channel();
        std::thread::spawn(move || output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        Ok(receiver)
    }

    /// Whether it runs, as far as the system says.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Asks it to end, as Ctrl-C would.
    pub fn interrupt(&self) {
        if let Some(pid) = rustix::process::Pid::from_raw(self.child.id() as i32) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::INT);
        }
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// [`ProcessError::Failed`] if its exit code is not 0, [`ProcessError::Hung`] if it does not end in time.
    pub fn finish(&mut self, patience: Duration) -> Result<(), ProcessError> {
        let name = self.name;
        let start = Instant::now();
        while start.elapsed() < patience {
            match self.child.try_wait().map_err(|source| ProcessError::Wait { name, source })? {
                Some(status) if status.success() => return Ok(()),
                Some(status) => return Err(ProcessError::Failed { name, status }),
                None => std::thread::sleep(LOOK),
            }
        }
        Err(ProcessError::Hung { name, patience })
    }
}

impl Drop for Process {
    /// As Ctrl-C first: a process that is killed leaves its shared memory behind.
    fn drop(&mut self) {
        if !self.is_running() {
            return;
        }
        self.interrupt();
        if let Err(ProcessError::Hung { .. } | ProcessError::Wait { .. }) = self.finish(GRACE) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever runs the tests in the background has them ignore SIGINT, and a shell cannot catch what it was started to ignore.
    fn shell(script: &str) -> Process {
        let mut command = Command::new("env");
        Process::start("sh", command.args(["--default-signal=INT", "sh", "-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()))
            .unwrap()
    }

    #[test]
    fn what_a_process_says_and_how_it_ends_is_told() {
        let mut good = shell("echo one; echo two");
        assert_eq!(good.lines().unwrap().iter().collect::<Vec<_>>(), ["one", "two"]);
        good.finish(GRACE).unwrap();
        assert!(matches!(good.output(), Err(ProcessError::Stream("sh"))));
        let mut bad = shell("exit 3");
        let message = bad.finish(GRACE).unwrap_err().to_string();
        assert!(message.contains("sh ended with exit status: 3"), "{message}");
        assert!(!bad.is_running());
        let mut slow = shell("read line");
        assert!(slow.is_running());
        assert!(matches!(slow.finish(Duration::from_millis(30)), Err(ProcessError::Hung { .. })));
        let message = Process::start("none", &mut Command::new("/nonexistent")).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains("cannot start none"), "{message}");
    }

    #[test]
    fn a_dropped_process_ends_as_by_ctrl_c() {
        let folder = tempfile::tempdir().unwrap();
        let mark = folder.path().join("mark");
        let mut process = shell(&format!("trap 'echo ended >{}; exit 0' INT; echo ready; while :; do sleep 0.01; done", mark.display()));
        assert_eq!(process.lines().unwrap().recv().unwrap(), "ready");
        drop(process);
        assert_eq!(std::fs::read_to_string(mark).unwrap(), "ended\n");
    }
}
