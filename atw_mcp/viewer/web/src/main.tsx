import { render } from "preact";
import { listen } from "./keys";
import { linked } from "./link";
import { Shell } from "./shell";
import { open } from "./source";
import { runClock } from "./state";
import "uplot/dist/uPlot.min.css";
import "./style.css";

render(<Shell />, document.getElementById("app")!);
runClock();
listen();
void open().then(linked);
