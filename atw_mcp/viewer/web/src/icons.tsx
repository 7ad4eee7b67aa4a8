// Icons of buttons, 16 units square, drawn in the colour of the text.
const PATHS = {
  play: "M4 2.5v11l9-5.5z",
  pause: "M4 2.5h3v11H4zM9 2.5h3v11H9z",
  start: "M3 3h2v10H3zM13.5 3v10L6 8z",
  end: "M11 3h2v10h-2zM2.5 3v10L10 8z",
  back: "M11 3v10L4 8z",
  forward: "M5 3v10l7-5z",
  previous: "M8 3v10L2 8zM11.5 4.5L15 8l-3.5 3.5L8 8z",
  next: "M8 3v10l6-5zM4.5 4.5L8 8l-3.5 3.5L1 8z",
  loop: "M4.7 4.7h6.6v2L14 4l-2.7-2.7v2H3.3v4h1.4zM11.3 11.3H4.7v-2L2 12l2.7 2.7v-2h8v-4h-1.4z",
  follow: "M7 1h2v2.1A5 5 0 0 1 12.9 7H15v2h-2.1A5 5 0 0 1 9 12.9V15H7v-2.1A5 5 0 0 1 3.1 9H1V7h2.1A5 5 0 0 1 7 3.1zM8 5a3 3 0 1 0 0 6 3 3 0 0 0 0-6z",
  light: "M8 5a3 3 0 1 0 0 6 3 3 0 0 0 0-6zM7 0h2v3H7zM7 13h2v3H7zM0 7h3v2H0zM13 7h3v2h-3zM2 3.5L3.5 2l2 2L4 5.5zM10.5 12L12 10.5l2 2L12.5 14zM3.5 14L2 12.5l2-2L5.5 12zM12 5.5L10.5 4l2-2L14 3.5z",
  dark: "M6.5 1.5a5.5 5.5 0 0 0 8 8A7 7 0 1 1 6.5 1.5z",
  system: "M8 1a7 7 0 1 0 0 14A7 7 0 0 0 8 1zM8 3v10A5 5 0 0 1 8 3z",
  swap: "M5 2v3h8v2H5v3L1 6zM11 6v3h0zM11 14v-3H3V9h8V6l4 4z",
  plus: "M7 3h2v4h4v2H9v4H7V9H3V7h4z",
  minus: "M3 7h10v2H3z",
  whole: "M1 3h2v10H1zM13 3h2v10h-2zM4 8l3-3v2h2V5l3 3-3 3V9H7v2z",
} as const;

export type IconName = keyof typeof PATHS;

export function Icon({ name }: { name: IconName }) {
  return (
    <svg viewBox="0 0 16 16" aria-hidden="true">
      <path d={PATHS[name]} />
    </svg>
  );
}
