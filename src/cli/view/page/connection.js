// A viewer of Foxglove's WebSocket protocol, `foxglove.sdk.v1`: subscribes to topics, and connects again when the connection is lost.

const AGAIN_MS = 1000;
const MESSAGE_DATA = 1;

/** Calls `take(topic, bytes, loggedNs)` for each message of these topics, and `tell(isConnected)` when that changes. */
export function connect(url, topics, take, tell) {
  const socket = new WebSocket(url, ["foxglove.sdk.v1"]);
  const names = new Map();
  socket.binaryType = "arraybuffer";
  socket.onopen = () => tell(true);
  socket.onclose = () => {
    tell(false);
    setTimeout(() => connect(url, topics, take, tell), AGAIN_MS);
  };
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.op !== "advertise") return;
      const wanted = message.channels.filter((channel) => topics.includes(channel.topic));
      wanted.forEach((channel) => names.set(channel.id, channel.topic));
      socket.send(JSON.stringify({ op: "subscribe", subscriptions: wanted.map(({ id }) => ({ id, channelId: id })) }));
    } else {
      const view = new DataView(data);
      if (view.getUint8(0) === MESSAGE_DATA) take(names.get(view.getUint32(1, true)), new Uint8Array(data, 13));
    }
  };
}
