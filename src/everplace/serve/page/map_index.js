// The map, as the page asks of it: which frame stands where on the route, and which columns of a chart show it.

/** One version of the map. */
export class MapIndex {
  /** @param info What `GET /map` says. */
  constructor(info) {
    this.info = info;
    this.perBin = info.table.places_per_bin;
    this.bins = Math.ceil(info.places / this.perBin);
    this._frames = new Map(); // id: {id, drive, stem, order}
    this._ids = new Map(); // drive and stem: id
    this._ordersOfStem = new Map();
    this._shown = new Array(info.places).fill(null); // for each place the first frame that shows it, and by drive
    const conditions = new Map(info.drives.map((drive) => [drive.name, drive.condition]));
    for (const [drive, ids] of Object.entries(info.frames)) {
      ids.forEach((id, number) => {
        const frame = {
          id, drive, condition: conditions.get(drive),
          stem: info.stems[drive][number], order: info.order[drive][number],
        };
        this._frames.set(id, frame);
        this._ids.set(`${drive}/${frame.stem}`, id);
        if (frame.order !== null) this._place(frame);
      });
    }
  }

  _place(frame) {
    if (!this._ordersOfStem.has(frame.stem)) this._ordersOfStem.set(frame.stem, []);
    this._ordersOfStem.get(frame.stem).push(frame.order);
    this._shown[frame.order] ??= new Map();
    if (!this._shown[frame.order].has(frame.drive)) this._shown[frame.order].set(frame.drive, frame);
  }

  /** {id, drive, condition, stem, order}: a frame of the map. */
  frame(id) {
    return this._frames.get(id);
  }

  /** The frame that an answer names. */
  frameOfAnswer(answer) {
    return this._frames.get(this._ids.get(`${answer.drive}/${answer.database_frame}`));
  }

  /** Where, in the order of travel, the map shows what frames of this name show. */
  ordersOfStem(stem) {
    return this._ordersOfStem.get(stem) ?? [];
  }

  /** The number of the place that is the n-th in the order of travel. */
  placeNumber(order) {
    return this.info.place_order[order];
  }

  /** The column of charts in which a place lies. */
  bin(order) {
    return Math.floor(order / this.perBin);
  }

  /** "place 212", or "places 210 to 213" where a column holds more than one. */
  binName(bin) {
    const first = bin * this.perBin;
    const last = Math.min(first + this.perBin, this.info.places) - 1;
    const numbers = [first, last].map((order) => this.placeNumber(order));
    return first === last ? `place ${numbers[0]}` : `places ${numbers[0]} to ${numbers[1]}`;
  }

  /** A frame of the map that shows a column, of the wanted drive if it has one. */
  frameOfBin(bin, drive) {
    for (let order = bin * this.perBin; order < Math.min((bin + 1) * this.perBin, this.info.places); order += 1) {
      const frames = this._shown[order];
      if (frames) return frames.get(drive) ?? frames.values().next().value;
    }
    return null;
  }
}
