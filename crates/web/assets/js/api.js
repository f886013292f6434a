// What is asked of the server. A refusal is an Error whose message says what to do.

async function ask(method, path, body) {
  let answer;
  try {
    answer = await fetch(path, {
      method,
      headers: body === undefined ? {} : { "content-type": "application/json" },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    throw new Error("The program does not answer. It may have been stopped; start it again and this page goes on by itself.");
  }
  const json = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(json.detail ?? json.error ?? json.title ?? `The server answers ${answer.status}.`);
  return json;
}

export const get = (path) => ask("GET", path);
export const command = (request) => ask("POST", "api/commands", request);
export const master = (request) => ask("POST", "api/master", request);
export const play = (name, factor) => ask("POST", `api/scenarios/${encodeURIComponent(name)}/play`, { factor });
export const stopScenario = () => ask("POST", "api/scenarios/stop", {});
export const startRecording = (request) => ask("POST", "api/recordings", request);
export const removeRecording = (name) => ask("DELETE", `api/recordings/${encodeURIComponent(name)}`);
export const stopRecording = (name) => ask("POST", `api/recordings/${encodeURIComponent(name)}/stop`, {});
