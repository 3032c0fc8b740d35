/* Drives the renderer over a small block that does not move: the tip presses, drags and lifts under each law. */
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "stickslip_renderer.h"

namespace {

int failures = 0;

void holds(const std::string &what, bool pass) {
  std::printf("%s  %s\n", pass ? "pass" : "FAIL", what.c_str());
  if (!pass) ++failures;
}

/* 4 x 4 x 3 nodes at 10 mm, joined where they are closer than 15 mm, the top at z = 0 and the bottom fixed. */
struct Block {
  static constexpr int N = 4, LAYERS = 3;
  std::vector<double> rest, mass, stiffness, damping, length, v;
  std::vector<uint8_t> fixed;
  std::vector<uint32_t> springs, triangles;
  stickslip_body body{};

  static uint32_t node(int x, int y, int z) { return static_cast<uint32_t>((z * N + y) * N + x); }
  double distance(size_t i, size_t j) const {
    return std::hypot(rest[3 * i] - rest[3 * j], rest[3 * i + 1] - rest[3 * j + 1], rest[3 * i + 2] - rest[3 * j + 2]);
  }
  void square(uint32_t a, uint32_t b, uint32_t c, uint32_t d) { triangles.insert(triangles.end(), {a, b, c, a, c, d}); }

  Block() {
    for (int z = 0; z < LAYERS; ++z)
      for (int y = 0; y < N; ++y)
        for (int x = 0; x < N; ++x) {
          rest.insert(rest.end(), {0.01 * x, 0.01 * y, 0.01 * (z + 1 - LAYERS)});
          fixed.push_back(z == 0);
        }
    mass.assign(fixed.size(), 0.01), v.assign(rest.size(), 0.0);
    for (uint32_t i = 0; i < fixed.size(); ++i)
      for (uint32_t j = i + 1; j < fixed.size(); ++j)
        if (distance(i, j) < 0.015) springs.insert(springs.end(), {i, j}), length.push_back(distance(i, j));
    stiffness.assign(length.size(), 100.0), damping.assign(length.size(), 0.5);
    const int top = LAYERS - 1, last = N - 1;
    for (int a = 0; a < last; ++a) {
      for (int b = 0; b < last; ++b) {
        square(node(a, b, top), node(a + 1, b, top), node(a + 1, b + 1, top), node(a, b + 1, top));
        square(node(a, b, 0), node(a, b + 1, 0), node(a + 1, b + 1, 0), node(a + 1, b, 0));
      }
      for (int c = 0; c < top; ++c) {
        square(node(a, 0, c), node(a + 1, 0, c), node(a + 1, 0, c + 1), node(a, 0, c + 1));
        square(node(a, last, c), node(a, last, c + 1), node(a + 1, last, c + 1), node(a + 1, last, c));
        square(node(0, a, c), node(0, a, c + 1), node(0, a + 1, c + 1), node(0, a + 1, c));
        square(node(last, a, c), node(last, a + 1, c), node(last, a + 1, c + 1), node(last, a, c + 1));
      }
    }
    body.size = sizeof body;
    body.nodes = fixed.size(), body.rest = rest.data(), body.mass = mass.data(), body.fixed = fixed.data();
    body.springs = length.size(), body.spring_nodes = springs.data(), body.stiffness = stiffness.data();
    body.damping = damping.data(), body.rest_length = length.data();
    body.triangles = triangles.size() / 3, body.triangle_nodes = triangles.data();
  }
};

stickslip_setup setup_for(int32_t law, const char *options) {
  stickslip_setup setup{};
  setup.size = sizeof setup, setup.tick_s = 1e-3, setup.cycle_s = 0.1, setup.law = law;
  setup.friction_static = 0.6, setup.friction_kinetic = 0.4, setup.options = options;
  return setup;
}

std::string message(void *renderer) {
  char text[200];
  const uint64_t size = stickslip_renderer_message(renderer, text, sizeof text);
  return {text, static_cast<size_t>(size < sizeof text ? size : sizeof text)};
}

void hand_over(void *renderer, const Block &block, const double tip[3]) {
  stickslip_state state{};
  state.size = sizeof state, state.x = block.rest.data(), state.v = block.v.data(), state.tip = tip;
  stickslip_renderer_dispose(stickslip_renderer_swap(renderer, stickslip_renderer_build(renderer, &state)));
}

void drag(const Block &block, int32_t law) {
  const stickslip_setup setup = setup_for(law, "stiffness=200");
  void *renderer = stickslip_renderer_create(&block.body, &setup);
  double before[3] = {0.007, 0.012, 0.001}, work = 0.0;
  hand_over(renderer, block, before);
  bool free_is_zero = true, in_cone = true, pressed = true;
  int modes[4] = {};
  for (int i = 1; i <= 1000; ++i) {
    if (i % 100 == 0) hand_over(renderer, block, before);
    const double t = i * 1e-3;
    const double tip[3] = {0.007 + 0.012 * std::fmin(1.0, std::fmax(0.0, (t - 0.3) / 0.4)), 0.012,
                           0.001 - 0.004 * std::fmin(1.0, t / 0.3) + 0.004 * std::fmax(0.0, (t - 0.7) / 0.3)};
    stickslip_output out{};
    out.size = sizeof out;
    if (stickslip_renderer_tick(renderer, before, tip, &out) != 0) ++failures;
    const double *f = out.force, *n = out.normal;
    const double normal = f[0] * n[0] + f[1] * n[1] + f[2] * n[2];
    const double tangential = std::hypot(f[0] - normal * n[0], f[1] - normal * n[1], f[2] - normal * n[2]);
    if (out.mode == STICKSLIP_MODE_FREE && (f[0] != 0.0 || f[1] != 0.0 || f[2] != 0.0)) free_is_zero = false;
    const double friction = law == STICKSLIP_LAW_SLIDING ? 0.0 : law == STICKSLIP_LAW_STICKING ? INFINITY : 0.6;
    if (out.mode != STICKSLIP_MODE_FREE && !(normal > 0.0 && tangential <= friction * normal + 1e-12)) in_cone = false;
    if (i == 300 && !(std::fabs(f[2] - 0.6) < 1e-9)) pressed = false;
    for (int k = 0; k < 3; ++k) work -= f[k] * (tip[k] - before[k]), before[k] = tip[k];
    ++modes[out.mode];
  }
  static const char *const names[] = {"sliding: ", "sticking: ", "stick-slip: "};
  const std::string name = names[law];
  holds(name + "a press of 3 mm gives k times the depth", pressed);
  holds(name + "a free tick has no force", free_is_zero && modes[STICKSLIP_MODE_FREE] > 0);
  holds(name + "the force pushes and stays in the cone", in_cone);
  holds(name + "the path takes energy, or gives back what it took", work > -1e-12);
  if (law == STICKSLIP_LAW_STICK_SLIP)
    holds(name + "the drag sticks and slips", modes[STICKSLIP_MODE_STICK] > 10 && modes[STICKSLIP_MODE_SLIP] > 10);
  stickslip_renderer_destroy(renderer);
}

}  // namespace

int main() {
  const Block block;
  holds("version of the interface", stickslip_renderer_abi() == STICKSLIP_RENDERER_ABI);
  for (int32_t law : {STICKSLIP_LAW_SLIDING, STICKSLIP_LAW_STICKING, STICKSLIP_LAW_STICK_SLIP}) drag(block, law);

  const stickslip_setup setup = setup_for(STICKSLIP_LAW_STICK_SLIP, "");
  void *renderer = stickslip_renderer_create(&block.body, &setup);
  const double out_of_it[3] = {0.012, 0.013, 0.02}, deep[3] = {0.012, 0.013, -0.009};
  stickslip_output out{};
  out.size = sizeof out;
  holds("a tick before the first model is a fault", stickslip_renderer_tick(renderer, deep, deep, &out) != 0);
  hand_over(renderer, block, out_of_it);
  const double bad[3] = {std::nan(""), 0.0, -0.001};
  out.force[0] = 9.0;
  holds("a tip that is not a number is a fault without a force",
        stickslip_renderer_tick(renderer, out_of_it, bad, &out) != 0 && out.force[0] == 0.0 &&
            message(renderer).find("tip") != std::string::npos);
  holds("a jump into the body gives a bounded force",
        stickslip_renderer_tick(renderer, out_of_it, deep, &out) == 0 && out.force[2] > 0.0 && out.force[2] < 10.0);
  std::printf("      stiffness from the network: %.3g N/m\n", out.force[2] / 0.009);
  stickslip_renderer_destroy(renderer);

  for (const char *options : {"colour=blue", "stiffness=soft", "stiffness"}) {
    const stickslip_setup refused = setup_for(STICKSLIP_LAW_SLIDING, options);
    holds(std::string("refused: ") + options,
          !stickslip_renderer_create(&block.body, &refused) && !message(nullptr).empty());
    std::printf("      %s\n", message(nullptr).c_str());
  }
  Block loose;
  for (auto &flag : loose.fixed) flag = 0;
  const stickslip_setup plain = setup_for(STICKSLIP_LAW_SLIDING, "");
  holds("refused: a body without static stiffness", !stickslip_renderer_create(&loose.body, &plain));
  std::printf("%s: %d failures\n", failures ? "FAIL" : "pass", failures);
  return failures != 0;
}
