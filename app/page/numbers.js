// Numbers as people read them: as many digits as are known, a true minus sign, no exponent where it can be helped.

const DIGITS = 5; // significant digits where no error is known
const MOST_DIGITS = 8; // significant digits, however small the error is

// A number with the digits that its error leaves.
export function written(value, error) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e9 || size < 1e-6) return withMinus(value.toExponential(DIGITS - 1));
  const decimals = (digits) => Math.max(digits - 1 - Math.floor(Math.log10(size)), 0);
  const known = error > 0 ? Math.max(Math.ceil(-Math.log10(error)), 0) : decimals(DIGITS);
  return withMinus(value.toFixed(Math.min(known, decimals(MOST_DIGITS))));
}

// An error: one significant digit, rounded up.
export function writtenError(error) {
  if (error === null || error === undefined) return "";
  if (error === 0) return "0";
  const digit = 10 ** Math.floor(Math.log10(error));
  const up = Math.ceil(error / digit - 1e-9) * digit;
  return up >= 1e-7 && up < 1e6 ? up.toFixed(Math.max(-Math.floor(Math.log10(up) + 1e-9), 0)) : up.toExponential(0);
}

export function short(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e6 || size < 1e-4) return withMinus(value.toExponential(2));
  return withMinus(String(Number(value.toPrecision(5))));
}

function withMinus(text) {
  return text.replace("-", "−").replace("e−", "e-").replace(/e\+/, "e");
}
