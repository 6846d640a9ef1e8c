import { useState } from "preact/hooks";
import { api, type Schemas } from "../api/service";
import { ConfirmDialog } from "../components/confirm-dialog";
import { strings } from "../strings";

const texts = strings.work.cancel;

/** A button that cancels an open job, once that is agreed to. */
export function CancelJob({ job }: { job: Schemas["Job"] }) {
  const [asking, setAsking] = useState(false);
  const kind = strings.work.kinds[job.kind];
  return (
    <>
      <button
        type="button"
        aria-label={texts.title(kind)}
        disabled={job.cancel_requested}
        onClick={() => setAsking(true)}
      >
        {texts.button}
      </button>
      {asking && (
        <ConfirmDialog
          title={texts.title(kind)}
          action={texts.action}
          onConfirm={async () => {
            await api.POST("/v1/jobs/{job_id}:cancel", { params: { path: { job_id: job.id } } });
          }}
          onClose={() => setAsking(false)}
        >
          <p>{texts.text}</p>
        </ConfirmDialog>
      )}
    </>
  );
}
