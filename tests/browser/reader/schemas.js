// Foxglove's messages as its package @foxglove/schemas publishes them, and as a file of ours describes them.
import { foxgloveEnumSchemas, foxgloveMessageSchemas, generateProto } from "@foxglove/schemas/internal";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor";

const OPTIONS = { longs: Number, enums: String, defaults: true, arrays: true };

/** Every published message, whatever a file says. */
export function publishedTypes() {
  const root = new protobuf.Root();
  for (const file of ["timestamp", "duration"]) root.addJSON(protobuf.common.get(`google/protobuf/${file}.proto`).nested);
  for (const schema of Object.values(foxgloveMessageSchemas)) {
    if (["Timestamp", "Duration"].includes(schema.name)) continue;
    const enums = Object.values(foxgloveEnumSchemas).filter((each) => each.parentSchemaName === schema.name);
    protobuf.parse(generateProto(schema, enums), root, { keepCase: true });
  }
  root.resolveAll();
  return root;
}

/** What the schema record of a file says. */
export function describedTypes(schema) {
  return protobuf.Root.fromDescriptor(protobuf.descriptor.FileDescriptorSet.decode(schema.data)).resolveAll();
}

/** A message as plain data. */
export function decoded(types, name, bytes) {
  const type = types.lookupType(name);
  return type.toObject(type.decode(bytes), OPTIONS);
}
