import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { report } from "../store/notices";
import { strings } from "../strings";
import { Dialog } from "./dialog";
import { CheckField } from "./fields";

interface ConfirmDialogProps {
  title: string;
  /** What the button says. */
  action: string;
  /** A sentence to agree to before the button works; without it the button is enough. */
  agreement?: string;
  onConfirm: () => Promise<void>;
  onClose: () => void;
  /** What is lost. */
  children: ComponentChildren;
}

/** Asks before something is lost. */
export function ConfirmDialog({
  title,
  action,
  agreement,
  onConfirm,
  onClose,
  children,
}: ConfirmDialogProps) {
  const [agreed, setAgreed] = useState(agreement === undefined);
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    try {
      await onConfirm();
    } catch (error) {
      report(error);
    }
    onClose();
  };
  return (
    <Dialog title={title} onClose={onClose}>
      <form onSubmit={submit}>
        {children}
        {agreement !== undefined && (
          <CheckField checked={agreed} onChecked={setAgreed}>
            {agreement}
          </CheckField>
        )}
        <p class="actions">
          <button type="button" onClick={onClose}>
            {strings.components.cancel}
          </button>
          <button type="submit" class="danger" disabled={!agreed || busy}>
            {action}
          </button>
        </p>
      </form>
    </Dialog>
  );
}
