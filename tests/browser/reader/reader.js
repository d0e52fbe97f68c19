// Reads run.mcap with Foxglove's own reader, decodes every viewer topic with Foxglove's published schemas and draws a moment of it.
import { BlobReadable } from "@mcap/browser";
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";
import { draw } from "./draw.js";
import { decoded, describedTypes, publishedTypes } from "./schemas.js";

async function read(file) {
  const reader = await McapIndexedReader.Initialize({
    readable: new BlobReadable(file),
    decompressHandlers: { zstd: (buffer, size) => decompress(buffer, new Uint8Array(Number(size))) },
  });
  const wellKnown = [...reader.channelsById.values()].filter(({ schemaId }) => reader.schemasById.get(schemaId).name.startsWith("foxglove."));
  const published = publishedTypes();
  const described = new Map();
  const topics = new Map();
  for (const { topic, schemaId } of wellKnown) {
    const schema = reader.schemasById.get(schemaId);
    if (!described.has(schemaId)) described.set(schemaId, describedTypes(schema));
    topics.set(topic, Object.assign([], { schema: schema.name, types: described.get(schemaId) }));
  }
  const differing = new Set();
  const mistimed = new Set();
  for await (const message of reader.readMessages({ topics: wellKnown.map(({ topic }) => topic) })) {
    const topic = topics.get(reader.channelsById.get(message.channelId).topic);
    const told = decoded(published, topic.schema, message.data);
    if (JSON.stringify(told) !== JSON.stringify(decoded(topic.types, topic.schema, message.data))) differing.add(topic.schema);
    for (const each of [told, ...(told.transforms || []), ...(told.entities || []), ...(told.deletions || [])]) {
      const at = each.timestamp && BigInt(each.timestamp.seconds) * 1_000_000_000n + BigInt(each.timestamp.nanos);
      if (at !== undefined && at !== message.logTime) mistimed.add(topic.schema);
    }
    topic.push({ at: Number(message.logTime) / 1e9, message: told });
  }
  return { topics, differing: [...differing], mistimed: [...mistimed] };
}

document.getElementById("file").addEventListener("change", async (event) => {
  try {
    const { topics, differing, mistimed } = await read(event.target.files[0]);
    window.draw = (time) => draw(document.getElementById("scene"), topics, time);
    window.log = () => topics.get("/log").map(({ at, message }) => [at, message.level, message.message]);
    window.told = {
      differing,
      mistimed,
      topics: Object.fromEntries([...topics].map(([name, messages]) => [name, [messages.schema, messages.length]])),
    };
  } catch (fault) {
    document.getElementById("message").textContent = fault.stack;
    throw fault;
  } finally {
    document.documentElement.dataset.shown = 0;
  }
});
document.documentElement.dataset.shown = 0;
