// The state of this page.

import { watchNeeds } from "./needs.js";
import { PageState } from "./state.js";

export const state = new PageState();
watchNeeds(state); // before others read which controls can be used
