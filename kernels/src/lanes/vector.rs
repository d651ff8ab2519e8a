//! Sixteen numbers, one option each, on which every operation works at once; or the first few of them.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// The number of options side by side; chosen: two registers of eight hide the latency of a recurrence.
pub const LANES: usize = 16;

/// One number per option; instruction sets differ in how many of them lie in a register.
///
/// A narrow vector holds the numbers of the first `WIDTH` lanes alone, for work on fewer options than there are lanes. What
/// it finds of one is the same to the last bit.
pub trait Vector:
    Copy
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The number of lanes that it holds.
    const WIDTH: usize;
    /// The narrow vector of the same instruction set.
    type Narrow: Vector;
    /// The vector of the same instruction set for long work with many arrays: the narrow one where registers are few.
    type Roomy: Vector;
    /// As many numbers in single precision, for which `Single` and `Narrow` are itself; where there is no such vector, the
    /// same one.
    type Single: Vector;
    /// Whether the numbers are of single precision; what is taken in and given out is rounded to it.
    const IS_SINGLE: bool;

    /// The same number in every lane.
    fn all(x: f64) -> Self;
    /// One number per lane; those of lanes that it does not hold are not looked at.
    fn from_lanes(x: [f64; LANES]) -> Self;
    /// The numbers of all lanes; those that it does not hold are like the last that it holds.
    fn lanes(self) -> [f64; LANES];
    /// The number of one lane, below `WIDTH`.
    fn lane(&self, lane: usize) -> f64;
    /// `self` b + c, rounded once where the processor can.
    fn times_plus(self, b: Self, c: Self) -> Self;
    /// The smaller number of each lane.
    fn min(self, other: Self) -> Self;
    /// The larger number of each lane.
    fn max(self, other: Self) -> Self;
    /// The absolute value of each lane.
    fn abs(self) -> Self;
    /// The square root of each lane.
    fn sqrt(self) -> Self;
    /// `yes` where `self` < 0, else `no`.
    fn negative(self, yes: Self, no: Self) -> Self;
    /// 2^k from the sum of an integer k and 1.5 2^52, in single precision 1.5 2^23.
    fn power_of_two(self) -> Self;

    /// e with x = m 2^e, 1 <= m < 2, for normal x > 0.
    fn exponent(self) -> Self;
    /// m with x = m 2^e, 1 <= m < 2, for normal x > 0.
    fn mantissa(self) -> Self;

    /// Do a part of the work in a function of its own, compiled for the instruction set; one function of everything
    /// takes minutes to compile and is no faster.
    fn call<P: Part<Self>>(part: P) -> P::Result;
    /// Do a part of the work by `call` where registers are few, and in line where the whole is faster in one piece.
    fn apart<P: Part<Self>>(part: P) -> P::Result;

    /// The same but for the number of one lane.
    #[inline(always)]
    #[must_use]
    fn with_lane(self, lane: usize, x: f64) -> Self {
        let mut lanes = self.lanes();
        lanes[lane] = x;
        Self::from_lanes(lanes)
    }

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::all(0.0)
    }

    /// The number times every lane.
    #[inline(always)]
    fn times(self, x: f64) -> Self {
        self * Self::all(x)
    }

    /// The number added to every lane.
    #[inline(always)]
    fn plus(self, x: f64) -> Self {
        self + Self::all(x)
    }
}

/// A part of some work on one type of vectors.
pub trait Part<V> {
    /// What it returns.
    type Result;
    /// Do it; must be inlined, to be compiled for the instruction set.
    fn run(self) -> Self::Result;
}

/// Implement `Vector` for an array of registers from the operations on one; written out, for nothing here may remain a call.
macro_rules! vector {
    ($name:ident, $narrow:ident, $roomy:ident, $single:ident, $is_single:literal, $register:ty, $ops:ident, $width:literal, $count:literal: $($i:tt)*) => {
        #[derive(Clone, Copy)]
        pub struct $name([$register; $count]);

        vector!(@binary $name $ops ($($i)*) Add add);
        vector!(@binary $name $ops ($($i)*) Sub sub);
        vector!(@binary $name $ops ($($i)*) Mul mul);
        vector!(@binary $name $ops ($($i)*) Div div);

        impl std::ops::Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self([$($ops::neg(self.0[$i])),*])
            }
        }

        impl Vector for $name {
            const WIDTH: usize = $width * $count;
            type Narrow = $narrow;
            type Roomy = $roomy;
            type Single = $single;
            const IS_SINGLE: bool = $is_single;

            #[inline(always)]
            fn all(x: f64) -> Self {
                Self([$ops::all(x); $count])
            }
            #[inline(always)]
            fn from_lanes(x: [f64; LANES]) -> Self {
                let (parts, _) = x.as_chunks::<$width>();
                Self([$($ops::load(parts[$i])),*])
            }
            #[inline(always)]
            fn lanes(self) -> [f64; LANES] {
                let mut x = [0.0; LANES];
                let (parts, _) = x.as_chunks_mut::<$width>();
                $(parts[$i] = $ops::store(self.0[$i]);)*
                let last = x[Self::WIDTH - 1];
                x[Self::WIDTH..].fill(last);
                x
            }
            #[inline(always)]
            #[allow(clippy::modulo_one)]
            fn lane(&self, lane: usize) -> f64 {
                $ops::lane(&self.0[lane / $width], lane % $width)
            }
            #[inline(always)]
            fn times_plus(self, b: Self, c: Self) -> Self {
                Self([$($ops::times_plus(self.0[$i], b.0[$i], c.0[$i])),*])
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self([$($ops::min(self.0[$i], other.0[$i])),*])
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self([$($ops::max(self.0[$i], other.0[$i])),*])
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self([$($ops::abs(self.0[$i])),*])
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self([$($ops::sqrt(self.0[$i])),*])
            }
            #[inline(always)]
            fn negative(self, yes: Self, no: Self) -> Self {
                Self([$($ops::negative(self.0[$i], yes.0[$i], no.0[$i])),*])
            }
            #[inline(always)]
            fn power_of_two(self) -> Self {
                Self([$($ops::power_of_two(self.0[$i])),*])
            }
            #[inline(always)]
            fn exponent(self) -> Self {
                Self([$($ops::exponent(self.0[$i])),*])
            }
            #[inline(always)]
            fn mantissa(self) -> Self {
                Self([$($ops::mantissa(self.0[$i])),*])
            }
            #[inline(always)]
            fn apart<P: Part<Self>>(part: P) -> P::Result {
                $ops::apart::<Self, P>(part)
            }
            #[inline(always)]
            fn call<P: Part<Self>>(part: P) -> P::Result {
                $ops::call::<Self, P>(part)
            }
        }
    };
    (@binary $name:ident $ops:ident ($($i:tt)*) $trait:ident $method:ident) => {
        impl std::ops::$trait for $name {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self([$($ops::$method(self.0[$i], other.0[$i])),*])
            }
        }
    };
}
pub(super) use vector;
