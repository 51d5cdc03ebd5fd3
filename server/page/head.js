// The head: its position and orientation in WebXR's axes (x right, y up, -z forward), moved by keys and mouse.

const SPEED = 0.6; // metres a second
const TURN = 1.2; // radians a second, by arrow keys
const MOVES = { KeyW: [0, 0, -1], KeyS: [0, 0, 1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, -1, 0], KeyE: [0, 1, 0] };
const TURNS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Head {
  constructor(canvas) {
    this.pressed = new Set();
    this.start([0, 0, 0], [0, 0, 0, 1]);
    addEventListener("keydown", (event) => this.key(event, true));
    addEventListener("keyup", (event) => this.key(event, false));
    addEventListener("blur", () => this.pressed.clear());
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => event.buttons && this.turn(event.movementX, event.movementY));
  }

  start(position, [x, y, z, w]) {
    this.position = [...position];
    this.yaw = Math.atan2(2 * (w * y + x * z), 1 - 2 * (x * x + y * y));
    this.pitch = 0;
  }

  key(event, down) {
    if (!(event.code in MOVES || event.code in TURNS) || event.target.tagName === "SELECT") return;
    event.preventDefault();
    if (down) this.pressed.add(event.code); else this.pressed.delete(event.code);
  }

  turn(dx, dy) {
    this.yaw += dx * 0.004;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + dy * 0.004));
  }

  advance(seconds) {
    for (const code of this.pressed) {
      if (code in TURNS) {
        this.yaw += TURNS[code][0] * TURN * seconds;
        this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + TURNS[code][1] * TURN * seconds));
        continue;
      }
      const [x, y, z] = MOVES[code].map((part) => part * SPEED * seconds);
      this.position[0] += Math.cos(this.yaw) * x + Math.sin(this.yaw) * z;
      this.position[1] += y;
      this.position[2] += -Math.sin(this.yaw) * x + Math.cos(this.yaw) * z;
    }
  }

  orientation() { // x y z w: yaw about y, then pitch about x
    const [cy, sy, cp, sp] = [Math.cos(this.yaw / 2), Math.sin(this.yaw / 2), Math.cos(this.pitch / 2), Math.sin(this.pitch / 2)];
    return [cy * sp, sy * cp, -sy * sp, cy * cp];
  }
}
