// Sends commands to a drive by a client that openapi-typescript generated from the server's description.
import createClient from "openapi-fetch";
import type { components, paths } from "./api.js";

declare const process: { argv: string[] };

const baseUrl = process.argv[2] ?? "";
const server = createClient<paths>({ baseUrl });

type Refused = components["schemas"]["Problem"];

async function token(name: string): Promise<string> {
  const { data, error } = await server.POST("/api/v1/login", { body: { name, password: `${name}'s password` } });
  if (error) throw new Error(error.detail);
  return data.token;
}

async function command(name: string, verb: "set_reference" | "start" | "stop", args: Record<string, unknown> = {}): Promise<string | Refused> {
  const { data, error } = await server.POST("/api/v1/drives/{name}/{verb}", {
    params: { path: { name: "saw", verb } },
    headers: { Authorization: `Bearer ${await token(name)}` },
    body: { id: `${name} ${verb}`, arguments: args },
  });
  return error ?? data.outcome;
}

const refused = await command("anna", "start");
if (typeof refused === "string") throw new Error("anna only looks");
const reference = await command("otto", "set_reference", { percent: 10 });
const saw = { params: { path: { name: "saw" } }, headers: { Authorization: `Bearer ${await token("otto")}` } };
const lease = await server.POST("/api/v1/drives/{name}/lease", { ...saw, body: { seconds: 10 } });
if (lease.error) throw new Error(lease.error.detail);
const kept = await server.POST("/api/v1/drives/{name}/keep", {
  ...saw,
  body: { id: "otto keep", lease: lease.data.key, percent: 20 },
});
const { data: drive } = await server.GET("/api/v1/drives/{name}", {
  params: { path: { name: "saw" } },
  headers: { Authorization: `Bearer ${await token("anna")}` },
});
console.log(JSON.stringify({
  refused: [refused.status, refused.outcome, refused.error.kind],
  done: [reference, kept.data?.outcome ?? kept.error],
  armed: drive?.armed,
}));
