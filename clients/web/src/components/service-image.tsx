import { useEffect, useRef, useState } from "preact/hooks";
import { bytes } from "../api/service";
import { strings } from "../strings";

interface ServiceImageProps {
  /** Its path on the service. */
  path: string;
  /** What it shows; empty when the text beside it says so. */
  alt: string;
  class?: string;
}

/**
 * An image that the service sends to holders of a key.
 *
 * It is drawn on a canvas: an `img` cannot send the key, and the page's Content Security Policy forbids `blob:` URLs.
 */
export function ServiceImage({ path, alt, class: className }: ServiceImageProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [failed, setFailed] = useState(false);
  useEffect(() => {
    const aborter = new AbortController();
    setFailed(false);
    bytes(path, aborter.signal)
      .then((blob) => createImageBitmap(blob))
      .then((bitmap) => {
        if (canvas.current && !aborter.signal.aborted) draw(canvas.current, bitmap);
        bitmap.close();
      })
      .catch(() => {
        if (!aborter.signal.aborted) setFailed(true);
      });
    return () => aborter.abort();
  }, [path]);
  if (failed) return <div class={`image failed ${className ?? ""}`}>{strings.components.imageFailed}</div>;
  return (
    <canvas
      ref={canvas}
      {...(alt ? { role: "img" as const, "aria-label": alt } : { "aria-hidden": true })}
      class={`image ${className ?? ""}`}
      width={4}
      height={3}
    />
  );
}

function draw(canvas: HTMLCanvasElement, bitmap: ImageBitmap): void {
  canvas.width = bitmap.width;
  canvas.height = bitmap.height;
  canvas.getContext("2d")?.drawImage(bitmap, 0, 0);
}
