// What the parts of the page share: one state, and word of what has changed in it.

export const state = {
  scan: 0, // the replay stands at this scan
  cursor: null, // key pose that is pointed at, on the map or in a curve
  selection: null, // {type: "pose" | "closure", index}
  measured: [], // sightings clicked so far, two at most
  measuring: false,
  playing: false,
  colourBy: "time",
  visible: new Set(), // names of layers
};

const listeners = new Map();

/** Call `listener(state)` whenever one of the events, separated by blanks, happens. */
export function on(events, listener) {
  for (const event of events.split(" ")) {
    if (!listeners.has(event)) listeners.set(event, []);
    listeners.get(event).push(listener);
  }
}

/** Tell the listeners of an event. Events: scan cursor selection measured layers play theme. */
export function emit(event) {
  for (const listener of listeners.get(event) ?? []) listener(state);
}

/** Change the state and tell; nothing happens where nothing changes. */
export function set(event, changes) {
  const changed = Object.entries(changes).some(([name, value]) => state[name] !== value);
  if (!changed) return;
  Object.assign(state, changes);
  emit(event);
}
