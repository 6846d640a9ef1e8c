export const en = { title: "Scenes" };
