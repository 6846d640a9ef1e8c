import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { strings } from "../strings";
import { theme } from "../theme";
import type { Growth } from "./growth-series";

const texts = strings.work.growth;
const HEIGHT_PX = 150;
const CURSOR = { sync: { key: "growth" }, drag: { x: false, y: false } };

/** Charts of a model's growth over its updates. */
export function GrowthChart({ growth }: { growth: Growth }) {
  const numbers = growth.snapshots.map((_, index) => index + 1);
  return (
    <>
      {growth.psnr_db.some((level) => level !== null) ? (
        <Chart
          key="psnr"
          title={texts.psnr}
          data={[numbers, growth.psnr_db]}
          lines={[{ label: texts.psnrShort, colour: "--accent", scale: "y" }]}
        />
      ) : (
        <p class="muted small">
          {texts.psnr}: {texts.psnrLater}
        </p>
      )}
      <Chart
        key="size"
        title={`${texts.gaussians}, ${texts.points}`}
        data={[numbers, growth.gaussians, growth.points]}
        lines={[
          { label: texts.gaussians, colour: "--good", scale: "y" },
          { label: texts.points, colour: "--warn", scale: "right", dash: [6, 4] },
        ]}
      />
    </>
  );
}

interface Line {
  label: string;
  /** The custom property of its colour. */
  colour: string;
  /** Its axis: `y` is the left one. */
  scale: "y" | "right";
  dash?: number[];
}

interface ChartProps {
  title: string;
  data: uPlot.AlignedData;
  lines: readonly Line[];
}

function Chart({ title, data, lines }: ChartProps) {
  const box = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const now = theme.value;
  useEffect(() => {
    const element = box.current;
    if (!element) return;
    const made = new uPlot(optionsOf(element.clientWidth, lines), data, element);
    plot.current = made;
    const observer = new ResizeObserver(() =>
      made.setSize({ width: element.clientWidth, height: HEIGHT_PX }),
    );
    observer.observe(element);
    return () => {
      observer.disconnect();
      made.destroy();
    };
  }, [now]);
  useEffect(() => plot.current?.setData(data), [data]);
  return (
    <figure>
      <figcaption class="small">{title}</figcaption>
      <div ref={box} class="chart" role="img" aria-label={title} />
    </figure>
  );
}

function optionsOf(width: number, lines: readonly Line[]): uPlot.Options {
  const style = getComputedStyle(document.documentElement);
  const colour = (name: string) => style.getPropertyValue(name).trim();
  const axis = {
    stroke: colour("--muted"),
    grid: { stroke: colour("--line"), width: 0.5 },
    ticks: { show: false },
  };
  const short = (_: uPlot, values: number[]) => values.map(shortNumber);
  return {
    width,
    height: HEIGHT_PX,
    cursor: CURSOR,
    legend: { live: true },
    scales: { x: { time: false } },
    axes: [
      { ...axis, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500], size: 24 },
      { ...axis, values: short, size: 44 },
      ...(lines.length > 1
        ? [{ ...axis, scale: "right", side: 1, values: short, size: 44, grid: { show: false } }]
        : []),
    ],
    series: [
      { label: texts.snapshot },
      ...lines.map((line) => ({
        label: line.label,
        scale: line.scale,
        stroke: colour(line.colour),
        width: 2,
        points: { show: true, size: 6 },
        spanGaps: true,
        value: (_: uPlot, value: number | null) => (value === null ? "–" : shortNumber(value)),
        ...(line.dash ? { dash: line.dash } : {}),
      })),
    ],
  };
}

/** A number of an axis in few characters. */
function shortNumber(value: number): string {
  return value.toLocaleString("en-US", { notation: "compact", maximumFractionDigits: 1 });
}
