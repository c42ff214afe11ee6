// One stream of events per browser: the tab that holds a lock reads it and passes it on to the
// others. Six streams would use up the connections that a browser opens to one server.

const NAME = "rtask-activity";

/**
 * Follow the activity of the server.
 * @param {string} place id of the last event that the page shows
 * @param {(event: object, id: string) => void} onEvent
 * @param {(state: "live" | "lost" | "gap", detail?: string) => void} onState
 */
export function followActivity(place, onEvent, onState) {
  let last = place;
  const channel = new BroadcastChannel(NAME);

  function take(event, id) {
    last = id;
    onEvent(event, id);
  }

  /** Read the stream in this tab. */
  function lead() {
    const source = new EventSource(`/activity/events?since=${encodeURIComponent(last)}`);
    const pass = (message) => {
      channel.postMessage(message);
      deliver(message);
    };
    source.addEventListener("hello", () => pass({ state: "live" }));
    source.addEventListener("gap", (e) => pass({ state: "gap", detail: JSON.parse(e.data).detail }));
    source.addEventListener("activity", (e) => pass({ event: JSON.parse(e.data), id: e.lastEventId }));
    source.onerror = () => {
      pass({ state: "lost" });
      if (source.readyState !== EventSource.CLOSED) return; // the browser tries again by itself
      setTimeout(lead, 3000);
    };
    channel.addEventListener("message", ({ data }) => {
      if (data.hello) channel.postMessage({ state: "live" });
    });
    return new Promise(() => {}); // the lock is held until the tab closes
  }

  function deliver({ event, id, state, detail }) {
    if (state) onState(state, detail);
    if (event) take(event, id);
  }

  channel.addEventListener("message", ({ data }) => deliver(data));
  channel.postMessage({ hello: true });
  // Locks need a secure context; elsewhere each tab reads its own stream.
  if (navigator.locks) navigator.locks.request(NAME, lead);
  else lead();
}
