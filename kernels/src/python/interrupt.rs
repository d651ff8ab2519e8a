//! What long work asks every few milliseconds: a Python function whether it shall end, and Python for pending signals.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Mutex;
use std::thread::{self, ThreadId};
use std::time::Instant;

use pyo3::prelude::*;

/// The time between two questions, milliseconds; chosen: a call takes microseconds, and the interpreter may be busy.
const PAUSE: u64 = 5;

/// The function, if there is one, and what it has answered.
pub struct Question {
    function: Option<Py<PyAny>>,
    /// The thread that called the kernel: without a function it alone asks, as Python handles signals in one thread.
    caller: ThreadId,
    begin: Instant,
    /// The time of the next question, milliseconds since the beginning.
    next: AtomicU64,
    ended: AtomicBool,
    error: Mutex<Option<PyErr>>,
}

impl Question {
    /// The question that this function answers; without one the answer is no unless a signal raises, as Ctrl-C does.
    pub fn new(function: Option<Py<PyAny>>) -> Question {
        // Work that begins after the end asks at once.
        let first = if function.is_some() { 0 } else { PAUSE };
        Question {
            function,
            caller: thread::current().id(),
            begin: Instant::now(),
            next: AtomicU64::new(first),
            ended: AtomicBool::new(false),
            error: Mutex::new(None),
        }
    }

    /// Whether the work shall end: the function has said so or has failed, or the handler of a signal has raised.
    pub fn is_ended(&self) -> bool {
        if self.ended.load(Ordering::Relaxed) {
            return true;
        }
        let now = u64::try_from(self.begin.elapsed().as_millis()).unwrap_or(u64::MAX);
        let next = self.next.load(Ordering::Relaxed);
        let turn = |next| {
            let (order, unordered) = (Ordering::Relaxed, Ordering::Relaxed);
            let after = now.saturating_add(PAUSE);
            self.next.compare_exchange(next, after, order, unordered)
        };
        let may_ask = || self.function.is_some() || thread::current().id() == self.caller;
        if now < next || !may_ask() || turn(next).is_err() {
            return false;
        }
        let answer = Python::attach(|py| {
            py.check_signals()?;
            let function = self.function.as_ref();
            function.map_or(Ok(false), |function| function.call0(py)?.is_truthy(py))
        });
        let ended = answer.unwrap_or_else(|error| {
            if let Ok(mut kept) = self.error.lock() {
                *kept = Some(error);
            }
            true
        });
        self.ended.store(ended, Ordering::Relaxed);
        ended
    }

    /// Raise what the function or the handler of a signal has raised.
    pub fn result(self) -> PyResult<()> {
        match self.error.into_inner() {
            Ok(Some(error)) => Err(error),
            _ => Ok(()),
        }
    }
}
