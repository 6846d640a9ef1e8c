import { useState } from "preact/hooks";
import { wordsOf } from "../api/problem";
import { ConfirmDialog } from "../components/confirm-dialog";
import { formatBytes, formatCount, formatDuration, formatPercent } from "../components/format";
import { strings } from "../strings";
import { byProblem } from "./upload-problems";
import type { Upload, UploadQueue } from "./upload-queue";

const texts = strings.photographs.upload;
const SHOWN = 5;

/** How far the files of a scene are sent: in all, each that is on its way, and those that failed. */
export function UploadProgress({ queue }: { queue: UploadQueue }) {
  const [asking, setAsking] = useState(false);
  const uploads = queue.uploads.value;
  if (uploads.length === 0) return null;
  const { files, open, done, failed, bytes, sentBytes } = queue.totals.value;
  const share = bytes > 0 ? sentBytes / bytes : 1;
  const moving = uploads.filter((one) => ["checking", "sending", "pausing"].includes(one.state));
  const failures = uploads.filter((one) => one.state === "failed");
  const known = uploads.filter((one) => one.state === "known").length;
  const rejected = uploads.filter(
    (one) => one.judgement && !["accepted", "video"].includes(one.judgement.verdict),
  ).length;
  const title = open > 0 ? texts.title : failed > 0 ? texts.doneWithFailures(failed) : texts.done;
  return (
    <section class="uploads" aria-label={texts.title}>
      <div class="head">
        <strong class={failed > 0 && open === 0 ? "error grow" : "grow"}>{title}</strong>
        {failed > 0 && (
          <button type="button" onClick={() => queue.retryFailed()}>
            {texts.retry}
          </button>
        )}
        {open > 0 ? (
          <button type="button" onClick={() => setAsking(true)}>
            {texts.cancel}
          </button>
        ) : (
          <button type="button" onClick={() => queue.clear()}>
            {texts.clear}
          </button>
        )}
      </div>
      {open > 0 && <progress value={share} max={1} aria-label={texts.title} />}
      <p class="small tabular">
        {[
          texts.files(formatCount(done), formatCount(files)),
          ...(bytes > 0 ? [texts.bytes(formatBytes(sentBytes), formatBytes(bytes))] : []),
          ...(open > 0 ? speedOf(queue, bytes - sentBytes) : []),
          ...(known > 0 ? [texts.known(formatCount(known))] : []),
        ].join(" · ")}
        {rejected > 0 && <span class="warning"> · {texts.rejected(formatCount(rejected))}</span>}
      </p>
      <ul>
        {moving.map((one) => (
          <UploadLine key={one.id} upload={one} />
        ))}
      </ul>
      {byProblem(failures).map(({ message, hint, names }) => (
        <p key={message} class="small problem">
          <span class="error">{message}</span> <span class="hint">{hint}</span>{" "}
          {names.slice(0, SHOWN).join(", ")}
          {names.length > SHOWN && ` ${texts.more(names.length - SHOWN)}`}
        </p>
      ))}
      {asking && (
        <ConfirmDialog
          title={texts.cancelTitle}
          action={texts.cancel}
          onConfirm={async () => queue.cancel()}
          onClose={() => setAsking(false)}
        >
          <p>{texts.cancelText}</p>
        </ConfirmDialog>
      )}
    </section>
  );
}

function UploadLine({ upload }: { upload: Upload }) {
  return (
    <li class="small">
      <span class="name">{upload.file.name}</span>
      <span class="muted">{progressOf(upload)}</span>
      {upload.problem && <span class="problem">{wordsOf(upload.problem).message}</span>}
    </li>
  );
}

function progressOf({ state, sentBytes, file }: Upload): string {
  if (state !== "sending") return texts.states[state];
  return sentBytes < file.size ? formatPercent(sentBytes / file.size) : texts.states.arrived;
}

function speedOf(queue: UploadQueue, bytesLeft: number): string[] {
  const { bytes, files } = queue.speed.value;
  return [
    ...(files ? [texts.perMinute(formatCount(Math.round(files * 60)))] : []),
    ...(bytes ? [texts.left(formatDuration(bytesLeft / bytes))] : []),
  ];
}
