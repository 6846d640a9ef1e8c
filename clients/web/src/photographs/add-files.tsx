import { useEffect, useRef, useState } from "preact/hooks";
import { notify, report } from "../store/notices";
import { strings } from "../strings";
import { ACCEPTED, chosen, dropped, type Picked } from "./picked-files";
import { uploadsOf } from "./uploads";

const texts = strings.photographs;
const NAMED = 3;

function add(sceneId: string, { files, others }: Picked): void {
  if (others.length > 0) {
    const names = others.slice(0, NAMED).join(", ") + (others.length > NAMED ? " …" : "");
    notify("warning", texts.others(names, others.length), texts.nothingToSendHint);
  }
  if (files.length > 0) uploadsOf(sceneId).add(files);
  else if (others.length === 0) notify("warning", texts.nothingToSend, texts.nothingToSendHint);
}

/** Buttons that choose files or a folder to send. */
export function AddFiles({ sceneId }: { sceneId: string }) {
  const input = useRef<HTMLInputElement>(null);
  const choose = (folder: boolean) => {
    if (!input.current) return;
    input.current.webkitdirectory = folder;
    input.current.click();
  };
  return (
    <div class="add-files">
      <button type="button" class="primary" onClick={() => choose(false)}>
        {texts.add}
      </button>
      <button type="button" onClick={() => choose(true)}>
        {texts.addFolder}
      </button>
      <span class="hint small">{texts.dropHint}</span>
      <input
        ref={input}
        type="file"
        multiple
        accept={ACCEPTED}
        hidden
        aria-label={texts.add}
        onChange={(event) => {
          const list = event.currentTarget.files;
          if (list?.length) add(sceneId, chosen(list));
          event.currentTarget.value = ""; // so that the same files can be chosen again
        }}
      />
    </div>
  );
}

/** Takes files that are dropped anywhere on the page, and says so while they are dragged over it. */
export function DropTarget({ sceneId }: { sceneId: string }) {
  const [over, setOver] = useState(false);
  useEffect(() => {
    const withFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") ?? false;
    const drag = (event: DragEvent) => {
      if (!withFiles(event)) return;
      event.preventDefault();
      setOver(true);
    };
    const leave = (event: DragEvent) => {
      if (event.relatedTarget === null) setOver(false);
    };
    const drop = (event: DragEvent) => {
      if (!withFiles(event) || !event.dataTransfer) return;
      event.preventDefault();
      setOver(false);
      dropped(event.dataTransfer)
        .then((picked) => add(sceneId, picked))
        .catch(report);
    };
    addEventListener("dragenter", drag);
    addEventListener("dragover", drag);
    addEventListener("dragleave", leave);
    addEventListener("drop", drop);
    return () => {
      removeEventListener("dragenter", drag);
      removeEventListener("dragover", drag);
      removeEventListener("dragleave", leave);
      removeEventListener("drop", drop);
    };
  }, [sceneId]);
  return over ? <div class="drop-target">{texts.dropHere}</div> : null;
}
