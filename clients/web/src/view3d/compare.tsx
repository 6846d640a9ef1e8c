import { useEffect, useRef, useState } from "preact/hooks";
import { loadCameras } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { SelectField } from "../components/fields";
import { formatCount, formatDate, formatDecibels } from "../components/format";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { posesIn } from "./compared-poses";
import { sentence } from "./model-source";
import { renderOf } from "./service-renders";
import { type LastView, viewState } from "./view-state";
import "./view3d.css";

const texts = strings.view3d.compare;
/** The value of the choice that takes the pose of the 3D view. */
const VIEW = "view";

/**
 * Two snapshots at one pose, with a slider between them.
 *
 * The service renders both: that needs no graphics card, and the camera is the same to the pixel.
 */
export function Compare({ store }: SceneProps) {
  const snapshots = store.snapshots.value;
  const last = viewState().last.get(store.id) ?? null;
  const [chosen, setChosen] = useState<{ left: string | null; right: string | null }>({
    left: null,
    right: null,
  });
  const [pose, setPose] = useState(last ? VIEW : "");
  const [share, setShare] = useState(0.5);
  const find = (id: string | null, index: number) =>
    snapshots.find((one) => one.id === id) ?? snapshots[index];
  const right = find(chosen.right, 0);
  const left = find(chosen.left, right === snapshots[1] ? 0 : 1);
  const views = store.cameras.value?.views ?? [];
  if (!left || !right) return <p class="loading">{texts.tooFew}</p>;
  const image = pose === VIEW ? null : pose || views[0]?.image;
  return (
    <div class="compare">
      <div class="compare-choices">
        <SnapshotChoice
          label={texts.left}
          snapshots={snapshots}
          value={left}
          onChoose={(id) => setChosen({ ...chosen, left: id })}
        />
        <SelectField
          label={texts.pose}
          value={pose || (views[0]?.image ?? "")}
          onValue={setPose}
          options={[
            ...(last ? [{ value: VIEW, title: texts.ofView }] : []),
            ...views.map(({ image, name }) => ({ value: image, title: name })),
          ]}
        />
        <SnapshotChoice
          label={texts.right}
          snapshots={snapshots}
          value={right}
          onChoose={(id) => setChosen({ ...chosen, right: id })}
        />
      </div>
      <Renders
        left={left}
        right={right}
        image={image ?? null}
        view={image === null && last ? last : null}
        share={share}
        onShare={setShare}
      />
      <label class="compare-slider">
        <span class="visually-hidden">{texts.slider}</span>
        <input
          type="range"
          min={0}
          max={100}
          value={share * 100}
          onInput={(event) => setShare(Number(event.currentTarget.value) / 100)}
        />
      </label>
    </div>
  );
}

interface SnapshotChoiceProps {
  label: string;
  snapshots: readonly Schemas["Snapshot"][];
  value: Schemas["Snapshot"];
  onChoose: (id: string) => void;
}

function SnapshotChoice({ label, snapshots, value, onChoose }: SnapshotChoiceProps) {
  const { metrics } = value;
  const psnr = metrics.psnr_db ?? metrics.new_images_psnr_db;
  const quality = texts.quality[metrics.psnr_db === null ? "ofNewImages" : "ofHeldOut"](formatDecibels(psnr));
  return (
    <SelectField
      label={label}
      value={value.id}
      onValue={onChoose}
      options={snapshots.map((one) => ({
        value: one.id,
        title: texts.snapshot(formatDate(one.created_at), one.kind, formatCount(one.metrics.registered)),
      }))}
      hint={`${quality}, ${texts.gaussians(formatCount(metrics.gaussians))}`}
    />
  );
}

interface RendersProps {
  left: Schemas["Snapshot"];
  right: Schemas["Snapshot"];
  /** The photograph from whose camera both are seen; null: from `view`. */
  image: string | null;
  view: LastView | null;
  share: number;
  onShare: (share: number) => void;
}

function Renders({ left, right, image, view, share, onShare }: RendersProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const bitmaps = useRef<readonly [ImageBitmap, ImageBitmap] | null>(null);
  const [failure, setFailure] = useState("");
  const [loading, setLoading] = useState(true);
  const draw = () => {
    if (canvas.current && bitmaps.current) drawBoth(canvas.current, bitmaps.current, share);
  };
  useEffect(() => {
    const aborter = new AbortController();
    setLoading(true);
    setFailure("");
    load(left.id, right.id, image, view, aborter.signal)
      .then((loaded) => {
        for (const one of (aborter.signal.aborted ? loaded : bitmaps.current) ?? []) one.close();
        if (aborter.signal.aborted) return;
        bitmaps.current = loaded;
        setLoading(false);
      })
      .catch((error: unknown) => {
        if (aborter.signal.aborted) return;
        setFailure(sentence(error));
        setLoading(false);
      });
    return () => aborter.abort();
  }, [left.id, right.id, image, view]);
  useEffect(draw);
  useEffect(() => {
    const observer = new ResizeObserver(() => drawLatest.current());
    if (canvas.current) observer.observe(canvas.current);
    return () => {
      observer.disconnect();
      for (const one of bitmaps.current ?? []) one.close();
    };
  }, []);
  const drawLatest = useRef(draw);
  drawLatest.current = draw;
  const drag = (event: PointerEvent) => {
    if (event.buttons !== 1) return;
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    onShare(Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
  };
  return (
    <div class="compare-stage" onPointerDown={drag} onPointerMove={drag}>
      <canvas ref={canvas} class="layer" role="img" aria-label={texts.label} />
      {loading && <p role="status">{strings.loading}</p>}
      {failure && (
        <p class="error" role="alert">
          {failure}
        </p>
      )}
    </div>
  );
}

async function load(
  left: string,
  right: string,
  image: string | null,
  view: RendersProps["view"],
  signal: AbortSignal,
): Promise<[ImageBitmap, ImageBitmap]> {
  const [before, after] = await Promise.all([loadCameras(left), loadCameras(right)]);
  const poses = posesIn(before, after, image, view);
  if (!poses) throw new Error(texts.nowhere);
  return Promise.all([renderOf(left, poses[0], null, signal), renderOf(right, poses[1], null, signal)]);
}

/** Draw the left image to the left of the slider, the right one to its right. */
function drawBoth(
  canvas: HTMLCanvasElement,
  bitmaps: readonly [ImageBitmap, ImageBitmap],
  share: number,
): void {
  canvas.width = canvas.clientWidth * devicePixelRatio;
  canvas.height = canvas.clientHeight * devicePixelRatio;
  const context = canvas.getContext("2d");
  if (!context) return;
  const split = canvas.width * share;
  for (const [index, bitmap] of bitmaps.entries()) {
    const scale = Math.min(canvas.width / bitmap.width, canvas.height / bitmap.height);
    const [width, height] = [bitmap.width * scale, bitmap.height * scale];
    context.save();
    context.beginPath();
    context.rect(index === 0 ? 0 : split, 0, index === 0 ? split : canvas.width - split, canvas.height);
    context.clip();
    context.drawImage(bitmap, (canvas.width - width) / 2, (canvas.height - height) / 2, width, height);
    context.restore();
  }
  context.fillStyle = getComputedStyle(canvas).getPropertyValue("--accent");
  context.fillRect(split - 1.5 * devicePixelRatio, 0, 3 * devicePixelRatio, canvas.height);
}
