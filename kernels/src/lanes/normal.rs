//! Exponentials and the normal distribution of many numbers at once.

use super::vector::{Part, Vector};

/// 1/sqrt(2 pi).
pub const ONE_OVER_SQRT_TWO_PI: f64 = 0.398_942_280_401_432_7;
/// What the exponential of one precision needs: what is added to round to an integer and leave that in the lowest bits,
/// the largest |x| (e^x and e^-x are normal numbers), ln 2 in two parts, of which the first has so few bits that its
/// products with exponents are exact (Cody and Waite), and the first of the coefficients `EXPM1`.
struct Exponential {
    round: f64,
    largest: f64,
    ln_2: [f64; 2],
    first: usize,
}

const DOUBLE: Exponential = Exponential {
    round: ROUND,
    largest: LARGEST,
    ln_2: [LN_2_HIGH, LN_2_LOW],
    first: 0,
};
const SINGLE: Exponential = Exponential {
    round: 12_582_912.0,
    largest: 87.0,
    ln_2: [0.693_359_375, -2.121_944_400_546_905_7e-4],
    first: 6,
};

/// The upper part of ln 2, with so few bits that its products with exponents are exact (Cody and Waite).
#[allow(clippy::excessive_precision)] // 17 digits
const LN_2_HIGH: f64 = 6.931_471_803_691_238_2e-1;
/// The lower part of ln 2.
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// The number 1.5 2^52: adding it rounds to an integer and leaves that integer in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// The largest |x| of an exponential: e^x and e^-x are normal numbers.
const LARGEST: f64 = 708.0;

/// The coefficients 1/13!, ..., 1/2! of e^r - 1 = r (1 + r/2 + ...), for |r| <= ln(2)/2.
#[allow(clippy::excessive_precision)]
const EXPM1: [f64; 12] = [
    1.605_904_383_682_161_3e-10,
    2.087_675_698_786_81e-9,
    2.505_210_838_544_171_9e-8,
    2.755_731_922_398_589e-7,
    2.755_731_922_398_589e-6,
    2.480_158_730_158_73e-5,
    1.984_126_984_126_984e-4,
    1.388_888_888_888_889e-3,
    8.333_333_333_333_333e-3,
    4.166_666_666_666_666_4e-2,
    1.666_666_666_666_666_6e-1,
    0.5,
];

/// The coefficients of (y + 1.5) R(y), R being the Mills ratio, as a polynomial in (y - 4.5)/(y + 4.5), the highest power
/// first; derived as a Chebyshev expansion of degree 22 with 50 digits, relative error 1.2e-15.
#[allow(clippy::excessive_precision)]
const MILLS: [f64; 23] = [
    1.987_584_470_185_240_62e-9,
    -3.940_162_008_415_710_31e-9,
    -2.407_056_104_737_701_77e-8,
    3.613_933_463_117_635_89e-8,
    1.734_391_041_824_720_22e-7,
    -1.886_407_891_612_377_28e-7,
    -1.055_036_656_840_412_59e-6,
    9.325_083_709_374_707_01e-7,
    6.247_999_432_775_899_75e-6,
    -6.551_009_215_895_789_55e-6,
    -3.710_256_516_782_624_66e-5,
    6.698_619_862_195_053_69e-5,
    1.925_646_785_396_264_99e-4,
    -7.561_518_566_928_970_06e-4,
    -7.241_015_815_943_385_24e-5,
    6.451_454_838_465_004_59e-3,
    -2.124_292_215_460_179_75e-2,
    3.646_303_937_201_846_73e-2,
    -2.538_095_383_932_683_50e-2,
    -4.999_142_798_859_342_04e-2,
    2.110_976_000_542_471_86e-1,
    -4.322_137_286_079_830_17e-1,
    1.275_423_482_652_190_85,
];

/// The same for single precision, in (y - 3)/(y + 3) and of degree 8, relative error 8e-7.
const MILLS_SINGLE: [f64; 9] = [
    -6.891_837_202_3e-4,
    -1.006_119_421_6e-3,
    5.951_916_693_3e-3,
    6.314_112_115_1e-3,
    -4.917_002_296_7e-2,
    5.535_479_093_4e-2,
    1.132_360_222_4e-1,
    -5.006_489_150_2e-1,
    1.370_656_621_2,
];

/// (e^r - 1, 2^k) with x = r + k ln 2.
#[inline(always)]
fn split_exponential<V: Vector>(x: V) -> (V, V) {
    let Exponential {
        round,
        largest,
        ln_2: [high, low],
        first,
    } = if V::IS_SINGLE { SINGLE } else { DOUBLE };
    let x = x.max(V::all(-largest)).min(V::all(largest));
    let shifted = x.times_plus(V::all(std::f64::consts::LOG2_E), V::all(round));
    let k = shifted.plus(-round);
    let r = k.times_plus(V::all(-low), k.times_plus(V::all(-high), x));
    // Two interleaved polynomials in r^2 shorten the chain of dependent products.
    let r2 = r * r;
    let (mut odd, mut even) = (V::all(EXPM1[first]), V::all(EXPM1[first + 1]));
    for j in (first + 2..EXPM1.len()).step_by(2) {
        odd = odd.times_plus(r2, V::all(EXPM1[j]));
        even = even.times_plus(r2, V::all(EXPM1[j + 1]));
    }
    (
        odd.times_plus(r, even).times_plus(r2, r),
        shifted.power_of_two(),
    )
}

/// Define functions of one vector, each a part of its own (`Vector::apart`): in line, where registers are few, they leave
/// none to what calls them. Measured with AVX2 on a march through Gaussian integrals, which took a quarter longer then, as
/// did the crate's build.
macro_rules! functions {
    ($($(#[$doc:meta])* $name:ident($argument:ident: $part:ident) $body:block)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $name<V: Vector>($argument: V) -> V {
            V::apart($part($argument))
        }

        struct $part<V>(V);

        impl<V: Vector> Part<V> for $part<V> {
            type Result = V;

            #[inline(always)]
            fn run(self) -> V {
                let Self($argument) = self;
                $body
            }
        }
    )*};
}

functions! {
    /// e^x for |x| <= 708, clamped there beyond.
    exp(x: Exp) {
        let (small, power) = split_exponential(x);
        power.times_plus(small, power)
    }

    /// e^x - 1 for |x| <= 708, clamped there beyond; without cancellation for small x.
    expm1(x: Expm1) {
        let (small, power) = split_exponential(x);
        power.times_plus(small, power.plus(-1.0))
    }

    /// ln x for normal x > 0, by 2 artanh((m - 1)/(m + 1)) with the mantissa m between 0.7 and 1.4.
    ln(x: Ln) {
        // The number of terms of the series: (0.172)^22 is below rounding, (0.172)^10 in single precision.
        let terms: usize = if V::IS_SINGLE { 5 } else { 11 };
        let (m, e) = (x.mantissa(), x.exponent());
        let large = V::all(std::f64::consts::SQRT_2) - m;
        let (m, e) = (
            large.negative(m.times(0.5), m),
            large.negative(e.plus(1.0), e),
        );
        let f = m.plus(-1.0) / m.plus(1.0);
        let f2 = f * f;
        let mut p = V::zero();
        for k in (1..terms).rev() {
            #[allow(clippy::cast_precision_loss)]
            let c = 2.0 / (2 * k + 1) as f64;
            p = p.times_plus(f2, V::all(c));
        }
        let mantissa = (p * f2).times_plus(f, f + f);
        let [high, low] = if V::IS_SINGLE { SINGLE } else { DOUBLE }.ln_2;
        e.times_plus(V::all(high), e.times_plus(V::all(low), mantissa))
    }

    /// The Mills ratio N(-y)/N'(y) for y >= 0.
    mills_ratio(y: MillsRatio) {
        if V::IS_SINGLE {
            rational_mills_ratio(y, 3.0, &MILLS_SINGLE)
        } else {
            rational_mills_ratio(y, 4.5, &MILLS)
        }
    }
}

/// The Mills ratio from the coefficients of (y + 1.5) R(y), an odd number of them, in (y - `centre`)/(y + `centre`).
#[inline(always)]
fn rational_mills_ratio<V: Vector, const N: usize>(
    y: V,
    centre: f64,
    coefficients: &[f64; N],
) -> V {
    // One division for both quotients.
    let (left, right) = (y.plus(centre), y.plus(1.5));
    let inverse = V::all(1.0) / (left * right);
    let t = y.plus(-centre) * (right * inverse);
    let t2 = t * t;
    let (mut even, mut odd) = (V::all(coefficients[0]), V::all(coefficients[1]));
    for j in (2..N - 1).step_by(2) {
        even = even.times_plus(t2, V::all(coefficients[j]));
        odd = odd.times_plus(t2, V::all(coefficients[j + 1]));
    }
    even = even.times_plus(t2, V::all(coefficients[N - 1]));
    odd.times_plus(t, even) * (left * inverse)
}

/// N(d) density(s)/density(d), where `density` is that at s and `whole` the limit for large d.
#[inline(always)]
pub fn weighted_normal<V: Vector>(d: V, density: V, whole: V) -> V {
    let beyond = density * mills_ratio(d.abs()); // the mass on the far side of d
    d.negative(beyond, whole - beyond)
}

#[cfg(test)]
mod tests {
    use super::super::dispatch::{dispatch, forced, InstructionSet, Portable, Work};
    use super::super::vector::Vector;

    /// sqrt(pi/2), and R(y) from mpmath with 30 digits.
    const KNOWN_MILLS: [(f64, f64); 6] = [
        (0.0, 1.253_314_137_315_500_3),
        (0.5, 0.876_364_456_453_692_3),
        (1.0, 0.655_679_542_418_798_5),
        (3.0, 0.304_590_298_710_103),
        (10.0, 0.099_028_596_471_731_92),
        (40.0, 0.024_984_404_205_720_57),
    ];

    fn exp(x: f64) -> f64 {
        super::exp(Portable::all(x)).lanes()[3]
    }

    fn ln(x: f64) -> f64 {
        super::ln(Portable::all(x)).lanes()[7]
    }

    fn expm1(x: f64) -> f64 {
        super::expm1(Portable::all(x)).lanes()[5]
    }

    fn mills_ratio(y: f64) -> f64 {
        super::mills_ratio(Portable::all(y)).lanes()[0]
    }

    #[test]
    fn exponentials_agree_with_the_library() {
        for i in -7000..7000 {
            let x = f64::from(i) * 0.1;
            let (a, b) = (exp(x), x.exp());
            assert!((a - b).abs() <= 4e-16 * b, "{x}: {a} {b}");
        }
        for i in 1..20_000 {
            let x = f64::from(i) * f64::from(i) * 1e-4;
            let (a, b) = (ln(x), x.ln());
            assert!((a - b).abs() <= 4e-16 * b.abs().max(1.0), "{x}: {a} {b}");
        }
        for i in -300..300 {
            let x = f64::from(i) * 0.01 + 1e-9;
            let (a, b) = (expm1(x), x.exp_m1());
            assert!((a - b).abs() <= 6e-16 * b.abs(), "{x}: {a} {b}");
        }
    }

    #[test]
    fn the_mills_ratio_has_its_known_values() {
        for (y, r) in KNOWN_MILLS {
            let found = mills_ratio(y);
            assert!((found - r).abs() <= 3e-15 * r, "{y}: {found} {r}");
        }
    }

    /// Functions in single precision on an instruction set that has it.
    struct InSingle(f64);

    impl Work for InSingle {
        type Result = [f64; 4];

        #[inline(always)]
        fn run<V: Vector>(self) -> [f64; 4] {
            let x = V::Single::all(self.0);
            let found = [
                super::exp(x),
                super::expm1(x),
                super::ln(x),
                super::mills_ratio(x),
            ];
            found.map(|f| f.lanes()[3])
        }
    }

    #[test]
    fn single_precision_has_seven_digits_on_every_instruction_set() {
        for set in InstructionSet::available() {
            for i in 1..20_000 {
                let x = f64::from(f32::from_bits(0x3580_0000 + i * 0x2000)); // up to 85
                let [exp, expm1, ln, _] = forced::with(set, || dispatch(InSingle(x)));
                let close = |a: f64, b: f64| (a - b).abs() <= 5e-7 * b.abs().max(1e-3);
                assert!(close(exp, x.exp()), "{x}: {exp} on {set:?}");
                assert!(close(expm1, x.exp_m1()), "{x}: {expm1} on {set:?}");
                assert!(
                    (ln - x.ln()).abs() <= 3e-7 * x.ln().abs().max(1.0),
                    "{x}: {ln} on {set:?}"
                );
            }
            for (y, r) in KNOWN_MILLS {
                let found = forced::with(set, || dispatch(InSingle(y)))[3];
                assert!((found - r).abs() <= 1e-6 * r, "{y}: {found} {r} on {set:?}");
            }
        }
    }
}
