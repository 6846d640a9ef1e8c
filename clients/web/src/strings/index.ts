import { en as components } from "./components";
import { en as map } from "./map";
import { en as photographs } from "./photographs";
import { en as plans } from "./plans";
import { en as scenes } from "./scenes";
import { en as shell } from "./shell";
import { en as view3d } from "./view3d";
import { en as views } from "./views";
import { en as work } from "./work";

/** All texts of the page, by area; a translation replaces the files of this folder. */
export const strings = { ...shell, components, map, photographs, plans, scenes, view3d, views, work };
