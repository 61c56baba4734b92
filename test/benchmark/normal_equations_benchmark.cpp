// SPDX-License-Identifier: BSD-3-Clause
#include "support/window_scene.h"
#include "window/normal_equations.h"
#include "window/window_optimizer.h"
#include "window/window_step.h"

#include <benchmark/benchmark.h>

namespace dsorb::window {
namespace {

/// A full window: 8 keyframes of 640 x 480, about 2000 points.
const WindowScene& fullWindow() {
  static const WindowScene scene = [] {
    WindowSceneOptions options;
    options.frames = {0, 3, 6, 9, 12, 15, 18, 21};
    options.width = 640;
    options.height = 480;
    options.cell = 24;
    WindowScene made = makeWindowScene(options, {});
    perturb(made, 5e-4, 1);
    return made;
  }();
  return scene;
}

void BM_BuildSystem(benchmark::State& state) {
  WindowScene scene = fullWindow();
  const PairTable pairs(scene.window);
  const std::vector<PointRef> points = allPoints(scene.window);
  LinearizeOptions options;
  options.camera.intrinsics = state.range(0) != 0;
  NormalEquationsBuilder builder;
  WindowEquations equations;
  for (auto _ : state) {
    builder.build(scene.window, pairs, points, options, equations);
    benchmark::DoNotOptimize(equations.energy);
  }
  state.counters["points"] = static_cast<double>(points.size());
  state.counters["residuals"] = equations.used;
}
BENCHMARK(BM_BuildSystem)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void BM_EvaluatePatch(benchmark::State& state) {
  const WindowScene& scene = fullWindow();
  const PairTable pairs(scene.window);
  const std::vector<WindowPoint>& points = scene.window.keyframes[0].points;
  PatchSums sums;
  std::size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(evaluatePatch(points[i], pairs.rays(), pairs.at(0, 1), sums));
    if (++i == points.size()) i = 0;
  }
}
BENCHMARK(BM_EvaluatePatch)->Unit(benchmark::kNanosecond);

void BM_SolveStep(benchmark::State& state) {
  WindowScene scene = fullWindow();
  NormalEquationsBuilder builder;
  WindowEquations equations;
  const PairTable pairs(scene.window);
  builder.build(scene.window, pairs, allPoints(scene.window), {}, equations);
  WindowElimination elimination;
  std::vector<double> depth_step;
  const Eigen::MatrixXd gauge = gaugeDirections(scene.window);
  for (auto _ : state) {
    const Eigen::VectorXd step =
        withoutGauge(solveStep(scene.window, equations, {}, 1e-5, elimination).change, gauge);
    elimination.substituteBack(equations, step, depth_step);
    benchmark::DoNotOptimize(depth_step.data());
  }
}
BENCHMARK(BM_SolveStep)->Unit(benchmark::kMillisecond);

void BM_OptimizeWindow(benchmark::State& state) {
  const WindowScene& scene = fullWindow();
  WindowOptimizer optimizer{WindowOptions()};
  OptimizationReport report;
  for (auto _ : state) {
    state.PauseTiming();
    Window window = scene.window;
    state.ResumeTiming();
    report = optimizer.optimize(window);
  }
  state.counters["iterations"] = report.iterations;
  state.counters["residuals"] = report.residuals;
}
BENCHMARK(BM_OptimizeWindow)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace dsorb::window
