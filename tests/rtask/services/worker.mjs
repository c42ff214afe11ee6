// A worker in another language, as docs/workers.md describes it: node --experimental-websocket.
const [address, token] = process.argv.slice(2);
const socket = new WebSocket(address);
const number = { type: "number" };
const description = {
  name: "farm/Script",
  version: "1.0.0",
  summary: "Arithmetic in JavaScript",
  methods: {
    multiply: {
      summary: "Multiply a list by a number",
      request: {
        properties: { numbers: { type: "array", items: number }, factor: { ...number, default: 2 } },
        required: ["numbers"],
      },
      answer: { properties: { numbers: { type: "array", items: number } }, required: ["numbers"] },
      output: "numbers",
    },
  },
};
const say = (message) => socket.send(JSON.stringify(message));
socket.onopen = () =>
  say({ op: "advertise_service", id: "1", service: "/services/farm/Script", slots: 1, description });
socket.onmessage = ({ data }) => {
  const message = JSON.parse(data);
  if (message.op === "status") console.log(message.msg);
  if (message.op !== "call_service") return;
  const { numbers, factor = 2 } = message.args;
  if (factor === 0) {
    say({ op: "service_response", id: message.id, result: false, values: "nothing to multiply by" });
    return;
  }
  say({ op: "action_feedback", id: message.id, values: { progress: 0.5, message: "half" } });
  const values = { numbers: numbers.map((one) => one * factor) };
  say({ op: "service_response", id: message.id, result: true, values });
};
setInterval(() => say({ op: "worker_alive" }), 5000);
