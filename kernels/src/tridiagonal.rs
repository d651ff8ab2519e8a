//! A tridiagonal matrix whose bands are known to fit together.

use crate::error::{check_length, KernelError};

/// The matrix with `M[i, i-1] = lower[i-1]`, `M[i, i] = diagonal[i]`, `M[i, i+1] = upper[i]`.
#[derive(Clone, Copy, Debug)]
pub struct Tridiagonal<'a> {
    pub(crate) lower: &'a [f64],
    pub(crate) diagonal: &'a [f64],
    pub(crate) upper: &'a [f64],
}

impl<'a> Tridiagonal<'a> {
    /// Put the bands together.
    ///
    /// # Errors
    /// `diagonal` is empty, or `lower` or `upper` is not one shorter than it.
    pub fn new(
        lower: &'a [f64],
        diagonal: &'a [f64],
        upper: &'a [f64],
    ) -> Result<Self, KernelError> {
        let Some(couplings) = diagonal.len().checked_sub(1) else {
            return Err(KernelError::Empty);
        };
        check_length("lower", lower, couplings)?;
        check_length("upper", upper, couplings)?;
        Ok(Self {
            lower,
            diagonal,
            upper,
        })
    }

    /// The number of rows, at least 1.
    #[must_use]
    pub fn size(&self) -> usize {
        self.diagonal.len()
    }
}

#[cfg(test)]
mod tests {
    use super::Tridiagonal;

    #[test]
    fn one_row_needs_no_couplings() {
        assert_eq!(Tridiagonal::new(&[], &[2.0], &[]).unwrap().size(), 1);
    }

    #[test]
    fn bands_of_wrong_length_are_named() {
        let empty = Tridiagonal::new(&[], &[], &[]).unwrap_err();
        assert_eq!(
            empty.to_string(),
            "diagonal has length 0: must be at least 1"
        );
        let upper = Tridiagonal::new(&[1.0], &[2.0, 2.0], &[]).unwrap_err();
        assert_eq!(upper.to_string(), "upper has length 0: must be 1");
        let lower = Tridiagonal::new(&[1.0, 1.0], &[2.0, 2.0], &[1.0]).unwrap_err();
        assert_eq!(lower.to_string(), "lower has length 2: must be 1");
    }
}
