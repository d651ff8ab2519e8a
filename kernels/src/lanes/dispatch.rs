//! The same code for three instruction sets, chosen at run time: the only file of the crate with `unsafe`.
//!
//! Code that is generic in the vector type is compiled once for each instruction set, in the function below that carries
//! it (`run_avx512`, `run_avx2`). Whatever works on vectors must be inlined into that function or called through
//! `Vector::call`: any other call would leave the instruction set. A vector type of an instruction set is only made by code that `InstructionSet` has let in.
#![allow(unsafe_code)]

#[cfg(target_arch = "x86_64")]
use std::arch::is_x86_feature_detected;

use super::vector::{vector, Part, Vector, LANES};

/// The operations of one number.
mod portable {
    use super::Part;

    #[inline(never)]
    pub fn call<V, P: Part<V>>(part: P) -> P::Result {
        part.run()
    }
    #[inline(always)]
    pub fn apart<V, P: Part<V>>(part: P) -> P::Result {
        call(part)
    }
    #[inline(always)]
    pub fn all(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    pub fn load(x: [f64; 1]) -> f64 {
        x[0]
    }
    #[inline(always)]
    pub fn store(a: f64) -> [f64; 1] {
        [a]
    }
    #[inline(always)]
    pub fn lane(a: &f64, _: usize) -> f64 {
        *a
    }
    #[inline(always)]
    pub fn add(a: f64, b: f64) -> f64 {
        a + b
    }
    #[inline(always)]
    pub fn sub(a: f64, b: f64) -> f64 {
        a - b
    }
    #[inline(always)]
    pub fn mul(a: f64, b: f64) -> f64 {
        a * b
    }
    #[inline(always)]
    pub fn div(a: f64, b: f64) -> f64 {
        a / b
    }
    #[inline(always)]
    pub fn neg(a: f64) -> f64 {
        -a
    }
    #[inline(always)]
    pub fn times_plus(a: f64, b: f64, c: f64) -> f64 {
        a * b + c
    }
    #[inline(always)]
    pub fn min(a: f64, b: f64) -> f64 {
        if a < b {
            a
        } else {
            b
        }
    }
    #[inline(always)]
    pub fn max(a: f64, b: f64) -> f64 {
        if a > b {
            a
        } else {
            b
        }
    }
    #[inline(always)]
    pub fn abs(a: f64) -> f64 {
        a.abs()
    }
    #[inline(always)]
    pub fn sqrt(a: f64) -> f64 {
        a.sqrt()
    }
    #[inline(always)]
    pub fn negative(a: f64, yes: f64, no: f64) -> f64 {
        if a < 0.0 {
            yes
        } else {
            no
        }
    }
    #[inline(always)]
    pub fn power_of_two(a: f64) -> f64 {
        f64::from_bits((a.to_bits() << 52).wrapping_add(0x3ff0_0000_0000_0000))
    }
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    pub fn exponent(a: f64) -> f64 {
        (a.to_bits() >> 52) as f64 - 1023.0
    }
    #[inline(always)]
    pub fn mantissa(a: f64) -> f64 {
        f64::from_bits((a.to_bits() & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000)
    }
}

/// The number in single precision.
#[inline(always)]
#[allow(clippy::cast_possible_truncation)]
fn rounded(x: f64) -> f32 {
    x as f32
}

/// The operations of one register; sound because only `dispatch` makes these vectors, after asking the processor.
#[cfg(target_arch = "x86_64")]
macro_rules! register {
    ($module:ident, $register:ident, $number:ident, $width:literal, call($part:ident) = $call:expr; apart($same:ident) = $apart:expr;
     $($name:ident($($argument:ident),*) = $body:expr;)*
     ; all($same_number:ident) = $all:expr; load($source:ident) = $load:expr; store($target:ident, $value:ident) = $store:expr;) => {
        #[allow(clippy::wildcard_imports)]
        mod $module {
            use std::arch::x86_64::*;
            type R = $register;
            $(register!(@operation $name($($argument),*) = $body);)*
            #[inline(always)]
            pub fn call<V, P: super::Part<V>>($part: P) -> P::Result {
                // SAFETY: the processor has the instructions, see above.
                unsafe { $call }
            }
            #[inline(always)]
            pub fn apart<V, P: super::Part<V>>($same: P) -> P::Result {
                $apart
            }
            #[inline(always)]
            pub fn all($same_number: f64) -> R {
                // SAFETY: the processor has the instruction, see above.
                unsafe { $all }
            }
            #[inline(always)]
            pub fn load(x: [f64; $width]) -> R {
                let $source = x.as_ptr();
                // SAFETY: as many numbers are read as the array has.
                unsafe { $load }
            }
            #[inline(always)]
            pub fn lane(a: &R, lane: usize) -> f64 {
                assert!(lane < $width);
                // SAFETY: a register is so many numbers in a row.
                unsafe { (*std::ptr::from_ref(a).cast::<$number>().add(lane)).into() }
            }
            #[inline(always)]
            pub fn store($value: R) -> [f64; $width] {
                let mut x = [0.0; $width];
                let $target = x.as_mut_ptr();
                // SAFETY: as many numbers are written as the array has.
                unsafe { $store };
                x
            }
        }
    };
    (@operation $name:ident($($argument:ident),*) = $body:expr) => {
        #[inline(always)]
        pub fn $name($($argument: R),*) -> R {
            // SAFETY: the processor has the instruction, see above.
            unsafe { $body }
        }
    };
}

#[cfg(target_arch = "x86_64")]
register! { avx512, __m512d, f64, 8,
    call(part) = super::call_avx512(part);
    apart(part) = part.run(); // its 32 registers hold whole steps, which are up to a fifth faster in one piece
    add(a, b) = _mm512_add_pd(a, b);
    sub(a, b) = _mm512_sub_pd(a, b);
    mul(a, b) = _mm512_mul_pd(a, b);
    div(a, b) = _mm512_div_pd(a, b);
    times_plus(a, b, c) = _mm512_fmadd_pd(a, b, c);
    min(a, b) = _mm512_min_pd(a, b);
    max(a, b) = _mm512_max_pd(a, b);
    sqrt(a) = _mm512_sqrt_pd(a);
    abs(a) = _mm512_abs_pd(a);
    neg(a) = _mm512_sub_pd(_mm512_set1_pd(-0.0), a);
    negative(a, yes, no) =
        _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, _mm512_setzero_pd()), no, yes);
    power_of_two(a) = _mm512_castsi512_pd(_mm512_add_epi64(
        _mm512_slli_epi64::<52>(_mm512_castpd_si512(a)), _mm512_set1_epi64(0x3ff0_0000_0000_0000)));
    exponent(a) = _mm512_getexp_pd(a);
    mantissa(a) = _mm512_getmant_pd::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_ZERO>(a);
    ; all(x) = _mm512_set1_pd(x); load(source) = _mm512_loadu_pd(source);
    store(target, value) = _mm512_storeu_pd(target, value);
}

#[cfg(target_arch = "x86_64")]
register! { avx2, __m256d, f64, 4,
    call(part) = super::call_avx2(part);
    apart(part) = call(part);
    add(a, b) = _mm256_add_pd(a, b);
    sub(a, b) = _mm256_sub_pd(a, b);
    mul(a, b) = _mm256_mul_pd(a, b);
    div(a, b) = _mm256_div_pd(a, b);
    times_plus(a, b, c) = _mm256_fmadd_pd(a, b, c);
    min(a, b) = _mm256_min_pd(a, b);
    max(a, b) = _mm256_max_pd(a, b);
    sqrt(a) = _mm256_sqrt_pd(a);
    abs(a) = _mm256_andnot_pd(_mm256_set1_pd(-0.0), a);
    neg(a) = _mm256_xor_pd(_mm256_set1_pd(-0.0), a);
    negative(a, yes, no) = _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_LT_OQ>(a, _mm256_setzero_pd()));
    power_of_two(a) = _mm256_castsi256_pd(_mm256_add_epi64(
        _mm256_slli_epi64::<52>(_mm256_castpd_si256(a)), _mm256_set1_epi64x(0x3ff0_0000_0000_0000)));
    // The exponent's bits under those of 2^52 are that number plus the exponent.
    exponent(a) = _mm256_sub_pd(
        _mm256_castsi256_pd(_mm256_or_si256(
            _mm256_srli_epi64::<52>(_mm256_castpd_si256(a)), _mm256_set1_epi64x(0x4330_0000_0000_0000))),
        _mm256_set1_pd(4_503_599_627_370_496.0 + 1023.0));
    mantissa(a) = _mm256_castsi256_pd(_mm256_or_si256(
        _mm256_and_si256(_mm256_castpd_si256(a), _mm256_set1_epi64x(0x000f_ffff_ffff_ffff)),
        _mm256_set1_epi64x(0x3ff0_0000_0000_0000)));
    ; all(x) = _mm256_set1_pd(x); load(source) = _mm256_loadu_pd(source);
    store(target, value) = _mm256_storeu_pd(target, value);
}

#[cfg(target_arch = "x86_64")]
register! { avx512_single, __m512, f32, 16,
    call(part) = super::call_avx512(part);
    apart(part) = part.run();
    add(a, b) = _mm512_add_ps(a, b);
    sub(a, b) = _mm512_sub_ps(a, b);
    mul(a, b) = _mm512_mul_ps(a, b);
    div(a, b) = _mm512_div_ps(a, b);
    times_plus(a, b, c) = _mm512_fmadd_ps(a, b, c);
    min(a, b) = _mm512_min_ps(a, b);
    max(a, b) = _mm512_max_ps(a, b);
    sqrt(a) = _mm512_sqrt_ps(a);
    abs(a) = _mm512_abs_ps(a);
    neg(a) = _mm512_sub_ps(_mm512_set1_ps(-0.0), a);
    negative(a, yes, no) =
        _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, _mm512_setzero_ps()), no, yes);
    power_of_two(a) = _mm512_castsi512_ps(_mm512_add_epi32(
        _mm512_slli_epi32::<23>(_mm512_castps_si512(a)), _mm512_set1_epi32(0x3f80_0000)));
    exponent(a) = _mm512_getexp_ps(a);
    mantissa(a) = _mm512_getmant_ps::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_ZERO>(a);
    ; all(x) = _mm512_set1_ps(super::rounded(x)); load(source) = _mm512_castpd_ps(_mm512_insertf64x4::<1>(
        _mm512_castpd256_pd512(_mm256_castps_pd(_mm512_cvtpd_ps(_mm512_loadu_pd(source)))),
        _mm256_castps_pd(_mm512_cvtpd_ps(_mm512_loadu_pd(source.add(8))))));
    store(target, value) = {
        let above = _mm256_castpd_ps(_mm512_extractf64x4_pd::<1>(_mm512_castps_pd(value)));
        _mm512_storeu_pd(target, _mm512_cvtps_pd(_mm512_castps512_ps256(value)));
        _mm512_storeu_pd(target.add(8), _mm512_cvtps_pd(above));
    };
}

#[cfg(target_arch = "x86_64")]
register! { avx2_single, __m256, f32, 8,
    call(part) = super::call_avx2(part);
    apart(part) = call(part);
    add(a, b) = _mm256_add_ps(a, b);
    sub(a, b) = _mm256_sub_ps(a, b);
    mul(a, b) = _mm256_mul_ps(a, b);
    div(a, b) = _mm256_div_ps(a, b);
    times_plus(a, b, c) = _mm256_fmadd_ps(a, b, c);
    min(a, b) = _mm256_min_ps(a, b);
    max(a, b) = _mm256_max_ps(a, b);
    sqrt(a) = _mm256_sqrt_ps(a);
    abs(a) = _mm256_andnot_ps(_mm256_set1_ps(-0.0), a);
    neg(a) = _mm256_xor_ps(_mm256_set1_ps(-0.0), a);
    negative(a, yes, no) = _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_LT_OQ>(a, _mm256_setzero_ps()));
    power_of_two(a) = _mm256_castsi256_ps(_mm256_add_epi32(
        _mm256_slli_epi32::<23>(_mm256_castps_si256(a)), _mm256_set1_epi32(0x3f80_0000)));
    exponent(a) = _mm256_cvtepi32_ps(_mm256_sub_epi32(
        _mm256_srli_epi32::<23>(_mm256_castps_si256(a)), _mm256_set1_epi32(127)));
    mantissa(a) = _mm256_castsi256_ps(_mm256_or_si256(
        _mm256_and_si256(_mm256_castps_si256(a), _mm256_set1_epi32(0x007f_ffff)), _mm256_set1_epi32(0x3f80_0000)));
    ; all(x) = _mm256_set1_ps(super::rounded(x)); load(source) = _mm256_set_m128(
        _mm256_cvtpd_ps(_mm256_loadu_pd(source.add(4))), _mm256_cvtpd_ps(_mm256_loadu_pd(source)));
    store(target, value) = {
        _mm256_storeu_pd(target, _mm256_cvtps_pd(_mm256_castps256_ps128(value)));
        _mm256_storeu_pd(target.add(4), _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(value)));
    };
}

vector!(Portable, PortableNarrow, PortableNarrow, Portable, false, f64, portable, 1, 16: 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
vector!(PortableNarrow, PortableNarrow, PortableNarrow, PortableNarrow, false, f64, portable, 1, 4: 0 1 2 3);
#[cfg(target_arch = "x86_64")]
vector!(Avx512, Avx2Narrow, Avx512, Avx512Single, false, std::arch::x86_64::__m512d, avx512, 8, 2: 0 1);
#[cfg(target_arch = "x86_64")]
vector!(Avx2, Avx2Narrow, Avx2, Avx2Single, false, std::arch::x86_64::__m256d, avx2, 4, 4: 0 1 2 3);
// One register of 256 bits serves AVX-512 as well, whose processors have both instruction sets.
#[cfg(target_arch = "x86_64")]
vector!(Avx2Narrow, Avx2Narrow, Avx2Narrow, Avx2Narrow, false, std::arch::x86_64::__m256d, avx2, 4, 1: 0);

// One register of 512 bits holds all numbers of single precision, so that a narrow vector would save little.
#[cfg(target_arch = "x86_64")]
vector!(Avx512Single, Avx512Single, Avx512Single, Avx512Single, true, std::arch::x86_64::__m512, avx512_single, 16, 1: 0);
#[cfg(target_arch = "x86_64")]
vector!(Avx2Single, Avx2Single, Avx2Single, Avx2Single, true, std::arch::x86_64::__m256, avx2_single, 8, 2: 0 1);

/// Work that any vector type can do.
pub trait Work {
    /// What it returns.
    type Result;
    /// Do it; must be inlined, to be compiled for the instruction set.
    fn run<V: Vector>(self) -> Self::Result;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    Portable,
}

/// An instruction set that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionSet(Kind); // private, so that only the functions below make one

impl InstructionSet {
    /// The one with the widest registers.
    #[inline]
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                return Self(Kind::Avx512);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                return Self(Kind::Avx2);
            }
        }
        Self(Kind::Portable)
    }

    /// All of them.
    #[cfg(test)]
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self(Kind::Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Self(Kind::Avx2));
            }
            if is_x86_feature_detected!("avx512f") {
                sets.push(Self(Kind::Avx512));
            }
        }
        sets
    }

    /// "avx512", "avx2" or "portable".
    #[cfg(any(test, feature = "python"))]
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
            Kind::Portable => "portable",
        }
    }

    /// Do the work with this instruction set.
    #[inline]
    fn run<W: Work>(self, work: W) -> W::Result {
        match self.0 {
            // SAFETY: the processor has the features, or there would be no such set.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { run_avx512(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { run_avx2(work) },
            Kind::Portable => work.run::<Portable>(),
        }
    }
}

/// Do the work with the widest registers that this processor has.
#[inline]
pub fn dispatch<W: Work>(work: W) -> W::Result {
    #[cfg(test)]
    if let Some(set) = forced::instruction_set() {
        return set.run(work);
    }
    InstructionSet::best().run(work)
}

/// Other instruction sets than the best one, for tests.
#[cfg(test)]
pub mod forced {
    use super::InstructionSet;
    use std::cell::Cell;

    thread_local! {
        static FORCED: Cell<Option<InstructionSet>> = const { Cell::new(None) };
    }

    pub(super) fn instruction_set() -> Option<InstructionSet> {
        FORCED.get()
    }

    /// Call the function with everything that this thread dispatches meanwhile done by one instruction set.
    pub fn with<R>(set: InstructionSet, function: impl FnOnce() -> R) -> R {
        FORCED.set(Some(set));
        let result = function();
        FORCED.set(None);
        result
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn run_avx512<W: Work>(work: W) -> W::Result {
    work.run::<Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<W: Work>(work: W) -> W::Result {
    work.run::<Avx2>()
}

#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma")]
fn call_avx2<V, P: Part<V>>(part: P) -> P::Result {
    part.run()
}

#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx512f")]
fn call_avx512<V, P: Part<V>>(part: P) -> P::Result {
    part.run()
}
