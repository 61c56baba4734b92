// SPDX-License-Identifier: BSD-3-Clause
#include "io/initialization_writer.h"

#include "io/output_file.h"
#include "io/run_json.h"

#include <cmath>
#include <cstdlib>
#include <utility>

namespace dsorb::io {
namespace {

template <typename Matrix>
Json rows(const Matrix& matrix) {
  Json result = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    result.push_back(std::move(row));
  }
  return result;
}

Json frameReference(const Frame& frame) {
  return {{"index", frame.id().value}, {"timestamp", frame.timestamp()}};
}

Json poses(const InitializationResult& result) {
  Json list = Json::array();
  for (const PosedFrame& posed : result.frames) {
    const bool known = posed.T_cam_ref && isFinite(*posed.T_cam_ref);
    const bool certain = known && posed.covariance && posed.covariance->allFinite();
    Json entry = frameReference(*posed.frame);
    entry["T_cam_ref"] = known ? rows(posed.T_cam_ref->matrix()) : Json();
    entry["affine"] = {posed.affine.a, posed.affine.b};
    entry["covariance"] = certain ? rows(*posed.covariance) : Json();
    list.push_back(std::move(entry));
  }
  return list;
}

/// Points hosted in the reference as [u, v, inverse depth, variance].
Json referencePoints(const InitializationResult& result) {
  Json list = Json::array();
  for (const InitPoint& point : result.points) {
    if (point.host != 0 || !point.pixel.allFinite() || !std::isfinite(point.inverse_depth) ||
        !std::isfinite(point.variance)) {
      continue;
    }
    list.push_back({shortest(point.pixel.x()),
                    shortest(point.pixel.y()),
                    shortest(point.inverse_depth),
                    shortest(point.variance)});
  }
  return list;
}

Json reportJson(const InitReport& report) {
  Json json = {{"model", report.model},
               {"frames_fed", report.frames_fed},
               {"frames_posed", report.frames_posed},
               {"restarts", report.restarts},
               {"points", report.points},
               {"median_parallax_deg", report.median_parallax_deg},
               {"inlier_ratio", report.inlier_ratio},
               {"residual_rms", report.residual_rms},
               {"median_relative_sigma", report.median_relative_sigma}};
  json["earlier_resets"] = Json::array();
  for (const InitReason reason : report.earlier_resets) {
    json["earlier_resets"].push_back(name(reason));
  }
  json["details"] = Json::object();
  for (const auto& [key, value] : report.details) json["details"][key] = value;
  return json;
}

void noteRollback(const std::optional<InitializationRollback>& rollback, Json& initialization) {
  initialization["withdrawn"] = rollback.has_value();
  initialization["withdrawal"] = nullptr;
  if (!rollback) return;
  initialization["withdrawal"] = {{"reason", name(rollback->reason)},
                                  {"index", rollback->frame.value},
                                  {"keyframes", rollback->keyframes},
                                  {"rms", rollback->rms},
                                  {"limit", rollback->limit}};
}

}  // namespace

InitializationWriter::InitializationWriter(std::filesystem::path path, std::string initializer)
    : path_(std::move(path)), initializer_(std::move(initializer)) {
  write();
}

void InitializationWriter::update(const RunRecord& record, double milliseconds) {
  if (record.estimate()) {
    if (record.estimate()->segment != progress_.segment) {
      progress_ = {};
      progress_.segment = record.estimate()->segment;
    }
    ++progress_.frames_given;
  }
  bool changed = false;
  if (record.rollback() && !initializations_.empty()) {
    noteRollback(record.rollback(), initializations_.back());
    changed = true;
  }
  for (const InitStepNote& step : record.steps()) {
    if (step.status == InitStatus::kRestarted && step.reason != InitReason::kFirstFrame) {
      ++progress_.resets;
      progress_.attempt_milliseconds = 0;
    }
  }
  if (!record.steps().empty()) {
    progress_.total_milliseconds += milliseconds;
    progress_.attempt_milliseconds += milliseconds;
  }
  for (const InitStepNote& step : record.steps()) {
    if (!step.result) continue;
    initializations_.push_back(describe(*step.result, milliseconds));
    noteRollback(step.rollback, initializations_.back());
    changed = true;
  }
  if (changed) write();
}

Json InitializationWriter::describe(const InitializationResult& result, double milliseconds) const {
  const Frame& reference = *result.frames.front().frame;
  const Frame& target = *result.frames.back().frame;
  Json json;
  json["initializer"] = initializer_;
  json["segment"] = progress_.segment;
  json["frames_given"] = progress_.frames_given;
  json["frames_since_reference"] = std::abs(target.id().value - reference.id().value);
  json["resets"] = progress_.resets;
  noteRollback(std::nullopt, json);  // until probation says otherwise
  json["reference"] = frameReference(reference);
  json["target"] = frameReference(target);
  json["camera"] = cameraJson(camera_);
  json["poses"] = poses(result);
  json["points"] = referencePoints(result);
  Json stages = Json::object();
  for (const StageTime& stage : result.report.stages) stages[stage.stage] = stage.milliseconds;
  json["milliseconds"] = {{"total", progress_.total_milliseconds},
                          {"this_attempt", progress_.attempt_milliseconds},
                          {"last_frame", milliseconds},
                          {"stages", std::move(stages)}};
  json["report"] = reportJson(result.report);
  return json;
}

void InitializationWriter::write() const {
  replaceFile(path_, jsonText({{"initializations", initializations_}}));
}

}  // namespace dsorb::io
