// A drive that is played: its frames are answered in their order, as the service's filter rests on the last ones.

import { endSession, localize } from "./service.js";

const MATCHES = 7;

function newSession() {
  return [...crypto.getRandomValues(new Uint8Array(12))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * The frames, their answers so far, and the one that is shown. It calls `onShown` when another frame is shown,
 * `onState` when it starts or stops, `onProblem` with a sentence and `onNewMap` when the map has another version.
 */
export class PlayedDrive {
  constructor(name, frames, version, listeners) {
    Object.assign(this, { name, frames, version, ...listeners });
    this.answers = []; // one a frame that was answered, in order; null: the service could not answer it
    this.at = -1;
    this.playing = false;
    this.pace = 5; // frames a second; 0: no wait
    this.session = frames.length > 1 ? newSession() : null;
    this._asking = null;
    this._ended = false;
  }

  /** Stops for good. */
  end() {
    this._ended = true;
    this.playing = false;
    if (this.session !== null && this.answers.length) endSession(this.session);
  }

  /** Plays from the frame that is shown; from the beginning if that is the last. */
  async play() {
    if (this.playing) return;
    if (this.at === this.frames.length - 1) this.at = -1;
    this.playing = true;
    const run = (this._run = (this._run ?? 0) + 1); // a run that was paused may still wait for its next frame
    this.onState();
    while (this.playing && run === this._run && this.at < this.frames.length - 1) {
      const begun = performance.now();
      if (!(await this.show(this.at + 1))) break;
      const wait = this.pace ? 1000 / this.pace - (performance.now() - begun) : 0;
      await new Promise((resolve) => setTimeout(resolve, Math.max(wait, 0)));
    }
    if (run === this._run) this.pause();
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.onState();
  }

  /** Pauses, and goes some frames on or back. */
  async step(by) {
    this.pause();
    await this.show(Math.min(Math.max(this.at + by, 0), this.frames.length - 1));
  }

  /** Shows a frame that was answered, or answers the next one; tells whether there was an answer. */
  async show(number) {
    const target = Math.min(number, this.answers.length);
    if (target < this.answers.length) {
      this.at = target;
      this.onShown();
      return true;
    }
    this._asking ??= this._ask(target).finally(() => { this._asking = null; });
    return this._asking;
  }

  async _ask(number) {
    const { file, name } = this.frames[number];
    try {
      const answer = await localize(file, name, this.session, MATCHES);
      if (this._ended) return false;
      if (answer.version !== undefined && answer.version !== this.version) {
        this.onNewMap();
        return false;
      }
      this.answers.push(answer);
    } catch (error) {
      if (this._ended) return false;
      // A frame that the service refuses stays without an answer; one that it never saw is asked for again.
      const refused = [400, 413, 422].includes(error.status);
      if (refused) {
        this.answers.push(null);
        this.at = number;
        this.onShown();
      }
      this.onProblem(`Frame ${name} has no answer. ${error.message}`);
      return false;
    }
    this.at = number;
    this.onShown();
    return true;
  }
}
