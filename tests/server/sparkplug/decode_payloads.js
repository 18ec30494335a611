// Decode payloads, given as lines of hexadecimal digits, and print each as a line of JSON.
const payloads = require(process.argv[2]).get("spBv1.0");
const plain = (_, value) =>
  typeof value === "bigint" ? Number(value)
  : value && typeof value === "object" && "low" in value && "high" in value ? Number(value.toString())
  : value;
for (const line of require("fs").readFileSync(0, "utf8").split("\n").filter(Boolean)) {
  console.log(JSON.stringify(payloads.decodePayload(Buffer.from(line, "hex")), plain));
}
