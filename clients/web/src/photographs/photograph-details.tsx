import { Fragment } from "preact";
import { useState } from "preact/hooks";
import { api, type Schemas } from "../api/service";
import { ConfirmDialog } from "../components/confirm-dialog";
import { Dialog } from "../components/dialog";
import { download } from "../components/download";
import { formatBytes, formatDate } from "../components/format";
import { ServiceImage } from "../components/service-image";
import { report } from "../store/notices";
import { strings } from "../strings";
import { ImageState, originalOf, remarkOf, thumbnailOf } from "./image-state";

type Image = Schemas["Image"];
const texts = strings.photographs.details;

interface DetailsProps {
  image: Image;
  /** Called with −1 and 1 for the neighbours of the list. */
  onStep: (by: number) => void;
  onClose: () => void;
}

/** What the service knows of a photograph, and what can be done with it. */
export function PhotographDetails({ image, onStep, onClose }: DetailsProps) {
  const [large, setLarge] = useState(false);
  const thumbnail = thumbnailOf(image);
  return (
    <section class="photograph-details" aria-label={image.name}>
      <div class="head">
        <h2 class="grow">{image.name}</h2>
        <button type="button" class="quiet" aria-label={texts.previous} onClick={() => onStep(-1)}>
          ‹
        </button>
        <button type="button" class="quiet" aria-label={texts.next} onClick={() => onStep(1)}>
          ›
        </button>
        <button type="button" class="quiet" aria-label={texts.close} onClick={onClose}>
          ×
        </button>
      </div>
      <div class="body">
        {thumbnail && (
          <button
            type="button"
            class="quiet enlarge"
            aria-label={texts.enlarge}
            onClick={() => setLarge(true)}
          >
            <ServiceImage path={thumbnail} alt="" class="photograph" />
          </button>
        )}
        <Facts image={image} />
      </div>
      <Actions image={image} />
      {large && (
        <Dialog title={image.name} wide onClose={() => setLarge(false)}>
          <ServiceImage path={originalOf(image)} alt={image.name} class="original" />
          <p class="actions">
            <button type="button" onClick={() => setLarge(false)}>
              {strings.components.close}
            </button>
          </p>
        </Dialog>
      )}
    </section>
  );
}

function Facts({ image }: { image: Image }) {
  const remark = remarkOf(image);
  const rows: [string, string][] = [
    [texts.size, sizeOf(image)],
    ...(image.captured_at ? [[texts.taken, formatDate(image.captured_at)] as [string, string]] : []),
    [texts.received, formatDate(image.received_at)],
    ...priorRows(image.prior),
  ];
  return (
    <dl>
      <dt>{texts.state}</dt>
      <dd>
        <ImageState image={image} />
      </dd>
      {remark && (
        <>
          <dt>{texts.reason}</dt>
          <dd>
            {remark} {image.hint && <span class="hint">{image.hint}</span>}
          </dd>
        </>
      )}
      {rows.map(([name, value]) => (
        <Fragment key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </Fragment>
      ))}
    </dl>
  );
}

function sizeOf(image: Image): string {
  const bytes = formatBytes(image.size_bytes);
  if (image.width_px === null || image.height_px === null) return bytes;
  return texts.pixels(image.width_px, image.height_px, bytes);
}

function priorRows(prior: Image["prior"]): [string, string][] {
  if (!prior) return [];
  const rows: [string, string][] = [];
  const { latitude_deg, longitude_deg, altitude_m, x_m, y_m, z_m } = prior;
  if (latitude_deg !== null && longitude_deg !== null) {
    const place = texts.latitude(latitude_deg.toFixed(6), longitude_deg.toFixed(6));
    const datum = prior.altitude_datum ? texts.datums[prior.altitude_datum] : "";
    const altitude = altitude_m === null ? "" : `, ${texts.altitude(altitude_m.toFixed(1), datum)}`;
    rows.push([texts.position, `${place}${altitude} (${sourceOf(prior)})`]);
  } else if (x_m !== null && y_m !== null && z_m !== null) {
    rows.push([texts.position, texts.local(x_m.toFixed(2), y_m.toFixed(2), z_m.toFixed(2))]);
  }
  if (prior.yaw_deg !== null || prior.pitch_deg !== null) {
    const angle = (degrees: number | null) =>
      degrees === null ? strings.components.unknown : texts.angle(degrees.toFixed(1));
    rows.push([
      texts.attitude,
      texts.angles(angle(prior.yaw_deg), angle(prior.pitch_deg), angle(prior.roll_deg)),
    ]);
  }
  return rows;
}

function sourceOf(prior: NonNullable<Image["prior"]>): string {
  return prior.source === "metadata" ? texts.fromMetadata : texts.fromRequest;
}

function Actions({ image }: { image: Image }) {
  const [deleting, setDeleting] = useState(false);
  const [busy, setBusy] = useState(false);
  const params = {
    path: { scene_id: image.scene_id, hexadecimal: image.digest.slice("sha256:".length) },
  };
  const act = async (action: () => Promise<unknown>) => {
    setBusy(true);
    await action().catch(report);
    setBusy(false);
  };
  const leftOut = image.registration === "excluded" || image.registration === "quarantined";
  return (
    <div class="actions">
      {image.verdict === "accepted" && (
        <>
          <button
            type="button"
            disabled={busy}
            title={leftOut ? texts.includeTitle : texts.excludeTitle}
            onClick={() =>
              act(() =>
                leftOut
                  ? api.POST("/v1/scenes/{scene_id}/images/sha256:{hexadecimal}:include", { params })
                  : api.POST("/v1/scenes/{scene_id}/images/sha256:{hexadecimal}:exclude", { params }),
              )
            }
          >
            {leftOut ? texts.include : texts.exclude}
          </button>
          <button
            type="button"
            disabled={busy}
            onClick={() => act(() => download(originalOf(image), image.name))}
          >
            {texts.download}
          </button>
        </>
      )}
      <button type="button" class="danger" onClick={() => setDeleting(true)}>
        {texts.delete}
      </button>
      {deleting && (
        <ConfirmDialog
          title={texts.deleteTitle(image.name)}
          action={texts.deleteAction}
          onConfirm={async () => {
            await api.DELETE("/v1/scenes/{scene_id}/images/sha256:{hexadecimal}", { params });
          }}
          onClose={() => setDeleting(false)}
        >
          <p>{texts.deleteText}</p>
        </ConfirmDialog>
      )}
    </div>
  );
}
