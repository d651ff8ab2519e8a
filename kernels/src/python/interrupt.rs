//! A Python function that long work asks every few milliseconds whether it shall end.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Mutex;
use std::time::Instant;

use pyo3::prelude::*;

/// The time between two questions, milliseconds; chosen: a call takes microseconds, and the interpreter may be busy.
const PAUSE: u64 = 5;

/// The function, if there is one, and what it has answered.
pub struct Question {
    function: Option<Py<PyAny>>,
    begin: Instant,
    /// The time of the next question, milliseconds since the beginning.
    next: AtomicU64,
    ended: AtomicBool,
    error: Mutex<Option<PyErr>>,
}

impl Question {
    /// The question that this function answers; without one the answer is no.
    pub fn new(function: Option<Py<PyAny>>) -> Question {
        Question {
            function,
            begin: Instant::now(),
            next: AtomicU64::new(PAUSE),
            ended: AtomicBool::new(false),
            error: Mutex::new(None),
        }
    }

    /// Whether the work shall end: the function has said so, or has failed.
    pub fn is_ended(&self) -> bool {
        let Some(function) = &self.function else {
            return false;
        };
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
        if now < next || turn(next).is_err() {
            return false;
        }
        let answer = Python::attach(|py| function.call0(py)?.is_truthy(py));
        let ended = answer.unwrap_or_else(|error| {
            if let Ok(mut kept) = self.error.lock() {
                *kept = Some(error);
            }
            true
        });
        self.ended.store(ended, Ordering::Relaxed);
        ended
    }

    /// Raise what the function has raised.
    pub fn result(self) -> PyResult<()> {
        match self.error.into_inner() {
            Ok(Some(error)) => Err(error),
            _ => Ok(()),
        }
    }
}
