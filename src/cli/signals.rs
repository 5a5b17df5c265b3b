//! Signals by which a user, a shell or a queue asks the command to stop.

/// Calls `stop` on a thread of its own at each interrupt, hangup or request to terminate. A signal that the process was started to ignore, as by
/// `nohup` or as a job in the background of a script, stays ignored.
///
/// # Errors
/// The operating system's, if there can be no handler.
#[cfg(unix)]
pub fn on_request(mut stop: impl FnMut() + Send + 'static) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let requests = [SIGHUP, SIGINT, SIGTERM];
    let heeded = requests.iter().filter(|signal| !is_ignored(**signal));
    let mut signals = signal_hook::iterator::Signals::new(heeded)?;
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || signals.forever().for_each(|_| stop()))?;
    Ok(())
}

/// Whether the process ignores a signal. Only Linux says so in a file; elsewhere none counts as ignored.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mut lines = status.lines();
    let mask = lines.find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    // Signals are counted from 1, bits from 0.
    mask.is_some_and(|mask| (mask >> (signal - 1)) & 1 == 1)
}

/// Calls `stop` on a thread of its own at Ctrl-C and when the console is closed.
///
/// # Errors
/// The operating system's, if there can be no handler.
#[cfg(not(unix))]
pub fn on_request(stop: impl FnMut() + Send + 'static) -> std::result::Result<(), ctrlc::Error> {
    ctrlc::set_handler(stop)
}
