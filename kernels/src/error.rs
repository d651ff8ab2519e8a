//! What a kernel function refuses or cannot do.

use std::error::Error;
use std::fmt;

/// Why there is no answer; printed as "q has length 2: must be 3" or "pivot 5 is zero".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KernelError {
    /// A vector does not fit the matrix.
    Length {
        /// The argument.
        name: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        required: usize,
    },
    /// The matrix has no rows.
    Empty,
    /// Row `row` has the pivot zero, which no M-matrix has.
    ZeroPivot {
        /// Counted from 0.
        row: usize,
    },
}

impl fmt::Display for KernelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length {
                name,
                found,
                required,
            } => write!(f, "{name} has length {found}: must be {required}"),
            Self::Empty => write!(f, "diagonal has length 0: must be at least 1"),
            Self::ZeroPivot { row } => write!(f, "pivot {row} is zero"),
        }
    }
}

impl Error for KernelError {}

/// Return an error that names the vector unless it has the required length.
pub(crate) fn check_length<T>(
    name: &'static str,
    vector: &[T],
    required: usize,
) -> Result<(), KernelError> {
    let found = vector.len();
    if found == required {
        return Ok(());
    }
    Err(KernelError::Length {
        name,
        found,
        required,
    })
}
