// One conversation of npm roslib, unmodified, with a server; prints what it saw as one JSON line.
import { pathToFileURL } from "node:url";

const [, , url, folder] = process.argv;
const library = pathToFileURL(folder + "/node_modules/roslib/dist/RosLib.js");
const { Ros, Service, Topic, Action } = await import(library);

const seen = {};
const errors = [];
console.error = (...words) => errors.push(words.map(String).join(" "));

const connected = () =>
  new Promise((resolve, reject) => {
    const ros = new Ros();
    ros.on("connection", () => resolve(ros));
    ros.on("error", (error) => reject(new Error(String(error))));
    ros.connect(url);
  });
const call = (ros, name, request = {}, timeout = 10) =>
  new Promise((resolve, reject) =>
    new Service({ ros, name, serviceType: "rtask/Any" }).callService(
      request, resolve, (error) => reject(new Error(error)), timeout));
const until = async (test) => {
  for (let waited = 0; !test() && waited < 10_000; waited += 20)
    await new Promise((done) => setTimeout(done, 20));
  if (!test()) throw new Error("waited too long: " + test + JSON.stringify({ ...seen, errors }));
};

const robot = await connected();
const other = await connected();

// A service of the engine, an error, rosapi
seen.robot = (await call(robot, "/rtask/register_robot", JSON.parse(process.env.ROBOT))).robot;
seen.error = await call(robot, "/rtask/registr_robot").catch((error) => error.message);
seen.services = await new Promise((resolve) => robot.getServices(resolve));
seen.topics = await new Promise((resolve) => robot.getTopics(resolve));
seen.serviceType = await new Promise((resolve) => robot.getServiceType("/rtask/search_object", resolve));

// Topics: plain, PNG, CBOR; what was said before is latched
for (const compression of ["none", "png", "cbor"]) {
  const heard = [];
  const name = `/said_${compression}`;
  const about = { name, messageType: "std_msgs/String" };
  new Topic({ ros: robot, ...about, latch: true }).publish({ data: `grüß dich, ${compression}` });
  new Topic({ ros: other, ...about, compression }).subscribe((message) => heard.push(message.data));
  await until(() => heard.length > 0);
  seen[compression] = heard[0];
}

// A service that one robot provides and another calls
const add = new Service({ ros: robot, name: "/add_two_ints", serviceType: "demo/AddTwoInts" });
await add.advertise((request, response) => {
  response.sum = request.a + request.b;
  return request.a !== 0;
});
const names = () => new Promise((resolve) => other.getServices(resolve));
for (let tries = 0; tries < 200 && !(await names()).includes("/add_two_ints"); tries++);
seen.sum = (await call(other, "/add_two_ints", { a: 2, b: 40 })).sum;
seen.refused = await call(other, "/add_two_ints", { a: 0, b: 1 }).catch(() => "refused");

// An action that one robot provides: feedback, result, cancel
const about = { name: "/count", actionType: "demo/Count" };
const server = new Action({ ros: robot, ...about });
const cancelled = [];
server.advertise(
  (goal, id) => {
    if (goal.forever) return;
    for (let k = 1; k <= goal.to; k++) server.sendFeedback(id, { k });
    server.setSucceeded(id, { counted: goal.to });
  },
  (id) => { cancelled.push(id); server.setCanceled(id, {}); });
await call(other, "/rosapi/get_time");
seen.feedback = [];
const client = new Action({ ros: other, ...about });
for (let tries = 0; tries < 200; tries++)
  if ((await call(other, "/rosapi/action_servers")).action_servers.includes("/count")) break;
seen.counted = await new Promise((resolve, reject) =>
  client.sendGoal({ to: 3 }, (result) => resolve(result.counted),
    (feedback) => seen.feedback.push(feedback.k), reject));
seen.cancelled = await new Promise((resolve) => {
  const id = client.sendGoal({ forever: true }, () => resolve("succeeded"), undefined, () => resolve("cancelled"));
  client.cancelGoal(id);
});
seen.cancelReached = cancelled.length;
client.cancelAllGoals();

// Parameters
await new Promise((resolve, reject) =>
  call(robot, "/rosapi/set_param", { name: "/rate", value: "10" }).then(resolve, reject));
seen.param = JSON.parse((await call(other, "/rosapi/get_param", { name: "/rate" })).value);

// A provider that vanishes
robot.close();
seen.gone = await call(other, "/add_two_ints", { a: 1, b: 1 }).catch((error) => error.message);
other.close();
console.log(JSON.stringify({ ...seen, errors }));
process.exit(0);
