import { strings } from "../strings";
import { type Problem, refusal, ServiceError } from "./problem";
import { serverSent } from "./server-sent";
import { type Schemas, send } from "./service";

/**
 * Rank candidates: parts with those that have been scored, and the ranking in the last part.
 *
 * Hanging up cancels it. Throws `ServiceError`, also when the stream ends before the ranking.
 */
export async function* rankingParts(
  sceneId: string,
  request: Schemas["RankingRequest"],
  signal: AbortSignal,
): AsyncGenerator<Schemas["RankingPart"]> {
  const response = await send(`/v1/scenes/${sceneId}/rankings`, {
    method: "POST",
    headers: { Accept: "text/event-stream", "Content-Type": "application/json" },
    body: JSON.stringify(request),
    signal,
  });
  let ranked = false;
  for await (const { event, data } of serverSent(response)) {
    if (event === "problem") throw refusal(JSON.parse(data) as Problem, null);
    if (!data) continue;
    const part = JSON.parse(data) as Schemas["RankingPart"];
    ranked = part.ranking !== null;
    yield part;
  }
  if (!ranked) throw new ServiceError(strings.views.streamEnded, strings.views.streamEndedHint, "network", 0);
}
