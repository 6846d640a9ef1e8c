import { Dialog } from "../components/dialog";
import { strings } from "../strings";

/** How to move in the view. */
export function KeysDialog({ onClose }: { onClose: () => void }) {
  const texts = strings.view3d;
  return (
    <Dialog title={texts.help} onClose={onClose}>
      <table>
        <tbody>
          {texts.keysOf.map(([keys, effect]) => (
            <tr key={keys}>
              <td>
                <kbd>{keys}</kbd>
              </td>
              <td>{effect}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <form method="dialog" class="actions">
        <button type="submit">{strings.components.close}</button>
      </form>
    </Dialog>
  );
}
