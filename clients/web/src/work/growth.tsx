import { useMemo } from "preact/hooks";
import { formatCount, formatDate, formatDecibels } from "../components/format";
import { lazy } from "../components/lazy";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { growthOf, type Growth as Series } from "./growth-series";

const texts = strings.work.growth;
const GrowthChart = lazy(async () => (await import("./growth-chart")).GrowthChart);

/** How the model grew over its updates: charts, and the same as a table. */
export function Growth({ store }: SceneProps) {
  const snapshots = store.snapshots.value;
  const growth = useMemo(() => growthOf(snapshots), [snapshots]);
  if (growth.snapshots.length === 0) return null;
  return (
    <section class="growth">
      <h2>{texts.title}</h2>
      {growth.snapshots.length < 2 ? <p class="muted small">{texts.few}</p> : <GrowthChart growth={growth} />}
      <details>
        <summary class="small">{texts.asTable}</summary>
        <GrowthTable growth={growth} />
      </details>
    </section>
  );
}

function GrowthTable({ growth }: { growth: Series }) {
  return (
    <table class="small">
      <thead>
        <tr>
          <th scope="col">{texts.when}</th>
          <th scope="col" class="number">
            {texts.psnrShort}
          </th>
          <th scope="col" class="number">
            {texts.gaussians}
          </th>
          <th scope="col" class="number">
            {texts.points}
          </th>
          <th scope="col" class="number">
            {texts.registered}
          </th>
        </tr>
      </thead>
      <tbody>
        {growth.snapshots.map((one) => (
          <tr key={one.id}>
            <td>{formatDate(one.created_at)}</td>
            <td class="number">{formatDecibels(one.metrics.new_images_psnr_db)}</td>
            <td class="number">{formatCount(one.metrics.gaussians)}</td>
            <td class="number">{formatCount(one.metrics.points)}</td>
            <td class="number">{formatCount(one.metrics.registered)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
