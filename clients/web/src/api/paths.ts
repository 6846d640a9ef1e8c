/** The path of an image of a scene, by its digest, or of a part of it. */
export function imagePath(
  sceneId: string,
  digest: string,
  part?: "content" | "thumbnail" | "subtitles",
): string {
  const path = `/v1/scenes/${sceneId}/images/${digest}`;
  return part ? `${path}/${part}` : path;
}

/** The path of an artifact of a snapshot. */
export function artifactPath(snapshotId: string, name: string): string {
  return `/v1/snapshots/${snapshotId}/artifacts/${name}`;
}

/** The path of what a candidate of a ranking would show. */
export function picturePath(rankingId: string, candidateId: string, kind: "render" | "spectrum"): string {
  return `/v1/rankings/${rankingId}/candidates/${encodeURIComponent(candidateId)}/${kind}.png`;
}
