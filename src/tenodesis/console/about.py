"""What there is to see, for someone who has never seen such an instrument."""

ABOUT = """
**What you see.** A surgeon's instrument for keyhole surgery. The dark **grip** at the top is in the surgeon's hand, the
pale **disc** is the wall of the patient's body, and the **jaws** at the bottom work inside. The tube between them is
drawn short.

**How it works.** Turn the grip, and a pair of rolling gears pulls thin **tendons** in the tube; at the other end
another pair bends the jaws. The smaller gears down there bend about twice as far as the hand turns.

**What goes wrong.** Tendons stretch, like hard rubber bands. When tissue pushes the tip (**violet arrow**), it gives
way: the jaws are no longer where the hand wants them. The **green shadow** shows where they should be.

**What the motors do.** A motor at each tendon winds in what the stretch has taken, going by the tension it feels at the
handle's end alone. Nobody has to look at the tip.

**Try it.**
1. Move the slider *Handle yaw*: the jaws follow, and the shadow with them.
2. Put a load on the tip: the jaws fall behind the shadow. The tendons change colour with their tension.
3. Press *Enable* and choose the law *robust*: the motors bring the jaws back into the shadow. Choose *off* and see
   them go.

**STOP** halts the motors at once, for everybody. The Esc key does the same.
"""
