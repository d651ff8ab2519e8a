// Questions to the service, asked again where it is away, busy or slow.

const FIRST_WAIT = 1; // seconds
const LONGEST_WAIT = 30; // seconds
const SLOW = 2; // seconds without an answer before that is said
const GIVEN_UP = 30; // seconds without an answer before the question is asked again

export class ProblemError extends Error {
  constructor(status, problem) {
    super(problem.detail ?? problem.title ?? `status ${status}`);
    this.status = status;
    this.problem = problem;
  }
}

export class Service {
  // told(words, canTryNow): what stands in the way; an empty text where nothing does.
  constructor(told, key) {
    this.told = told;
    this.key = key;
    this.wake = () => {};
  }

  async ask(path, body, signal) {
    for (let attempt = 0; ; attempt += 1) {
      const { answer, why, wait } = await this.once(path, body, signal);
      if (answer) {
        this.told("");
        return answer;
      }
      const backoff = Math.min(FIRST_WAIT * 2 ** attempt, LONGEST_WAIT);
      await this.pause(why, Math.max(wait ?? 0, backoff), signal);
    }
  }

  // Return the answer, or why there is none and how many seconds to wait before the next attempt.
  async once(path, body, signal) {
    const slow = setTimeout(() => this.told("The service is still computing."), SLOW * 1000);
    try {
      const headers = { "Content-Type": "application/json" };
      if (this.key()) headers.Authorization = `Bearer ${this.key()}`;
      const limited = AbortSignal.any([signal, AbortSignal.timeout(GIVEN_UP * 1000)]);
      const response = await fetch(path, { method: "POST", headers, body: JSON.stringify(body), signal: limited });
      const found = await response.json();
      if (response.ok) return { answer: found };
      const isBusy = [429, 502, 503, 504].includes(response.status) && !found.type?.endsWith("#deadline");
      if (!isBusy) throw new ProblemError(response.status, found);
      return { why: `${found.title ?? "The service is busy"}.`, wait: Number(response.headers.get("Retry-After")) || 0 };
    } catch (error) {
      if (signal.aborted || error instanceof ProblemError) throw error;
      return { why: "The service does not answer." };
    } finally {
      clearTimeout(slow);
    }
  }

  async pause(why, seconds, signal) {
    this.told(`${why} Trying again in ${Math.round(seconds)} s; the numbers shown are older.`, true);
    await new Promise((resolve, reject) => {
      const timer = setTimeout(resolve, seconds * 1000);
      this.wake = () => { clearTimeout(timer); resolve(); };
      signal.addEventListener("abort", () => { clearTimeout(timer); reject(signal.reason); }, { once: true });
    });
  }
}
