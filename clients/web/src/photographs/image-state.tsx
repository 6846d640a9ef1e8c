import { imagePath } from "../api/paths";
import type { Schemas } from "../api/service";
import { formatCount } from "../components/format";
import { strings } from "../strings";
import { isProblem } from "./filters";

const texts = strings.photographs;

/** Whether an image is used, in a word. */
export function stateOf(image: Schemas["Image"]): string {
  if (image.verdict !== "accepted") return texts.verdicts[image.verdict];
  return texts.registrations[image.registration];
}

/** What else there is to say about an image in a line; empty when all is well. */
export function remarkOf(image: Schemas["Image"]): string {
  if (image.verdict === "video") {
    return image.frames === null ? texts.framesWait : texts.frames(image.frames, formatCount(image.frames));
  }
  return image.reason || image.warnings.map((one) => texts.warnings[one]).join(" ");
}

/** The state of an image as a badge. */
export function ImageState({ image }: { image: Schemas["Image"] }) {
  const good = image.registration === "registered" && !isProblem(image);
  const tone = isProblem(image) ? "warning" : good ? "good" : "muted";
  return <span class={`badge ${tone}`}>{stateOf(image)}</span>;
}

/** The path of the original of an accepted image. */
export function originalOf(image: Schemas["Image"]): string {
  return imagePath(image.scene_id, image.digest, "content");
}

/** The path of an image's thumbnail; null when the service keeps none. */
export function thumbnailOf(image: Schemas["Image"]): string | null {
  return image.verdict === "accepted" ? imagePath(image.scene_id, image.digest, "thumbnail") : null;
}
