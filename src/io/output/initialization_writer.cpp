// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/initialization_writer.h"

#include "io/output/run_json.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace dsorb::io {
namespace {

constexpr std::string_view kHead = "{\n \"initializations\": [";
constexpr int kDepth = 2;  // of an initialization in the file

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

Json reportJson(const InitializationResult& result) {
  const InitReport& report = result.report;
  const auto posed = std::count_if(result.frames.begin(), result.frames.end(), [](const auto& f) {
    return f.T_cam_ref.has_value();
  });
  Json json = {{"model", report.model},
               {"frames_fed", result.frames.size()},
               {"frames_posed", posed},
               {"restarts", report.restarts},
               {"points", result.points.size()},
               {"median_relative_sigma", report.median_relative_sigma}};
  const auto add = [&json](const char* name, const auto& value) {
    json[name] = value ? Json(*value) : Json(nullptr);
  };
  add("wrong_probability", report.wrong_probability);
  add("known_depth_used", report.depth_prior);
  add("known_pose_used", report.pose_prior);
  json["earlier_resets"] = Json::array();
  for (const InitReason reason : report.earlier_resets) {
    json["earlier_resets"].push_back(name(reason));
  }
  Json& details = json["details"] = Json::object();
  for (const Detail& detail : report.details) details[detail.name] = detail.value;
  return json;
}

void noteRefusal(const std::optional<StartRefusal>& refusal, Json& initialization) {
  initialization["withdrawn"] = refusal.has_value();
  initialization["withdrawal"] = nullptr;
  if (!refusal) return;
  const StartChange& change = refusal->change;
  initialization["withdrawal"] = {{"reason", name(refusal->reason)},
                                  {"index", refusal->frame.value},
                                  {"direction_deg", change.direction_deg},
                                  {"depth_spread", change.depth_spread},
                                  {"depth_change", change.depth_change},
                                  {"kept_share", change.kept_share}};
}

}  // namespace

InitializationWriter::InitializationWriter(std::filesystem::path path, std::string initializer)
    : file_(std::move(path), std::string(kHead) + "]\n}\n"),
      initializer_(std::move(initializer)),
      last_begin_(kHead.size()) {}

void InitializationWriter::update(const RunRecord& record, double milliseconds) {
  if (record.estimate()) {
    if (record.estimate()->segment != progress_.segment) {
      progress_ = {};
      progress_.segment = record.estimate()->segment;
    }
    ++progress_.frames_given;
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
    add(describe(step, milliseconds));
  }
  if (changed_) write();
}

Json InitializationWriter::describe(const InitStepNote& step, double milliseconds) const {
  const InitializationResult& result = *step.result;
  const Frame& reference = *result.frames.front().frame;
  const Frame& target = *result.frames.back().frame;
  Json json;
  json["initializer"] = initializer_;
  json["segment"] = progress_.segment;
  json["frames_given"] = progress_.frames_given;
  json["frames_since_reference"] = std::abs(target.id().value - reference.id().value);
  json["resets"] = progress_.resets;
  noteRefusal(step.refusal, json);
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
  if (result.metric) {
    json["metric"] = {{"metres_per_unit", result.metric->metres},
                      {"relative_sigma", result.metric->relative_sigma}};
  }
  json["report"] = reportJson(result);
  return json;
}

void InitializationWriter::add(Json initialization) {
  if (changed_) write();  // the one before, for the last time
  if (!last_.is_null()) last_begin_ += last_size_;
  last_ = std::move(initialization);
  changed_ = true;
}

void InitializationWriter::write() {
  std::string text = last_begin_ == kHead.size() ? "\n  " : ",\n  ";
  text += jsonText(last_, kDepth);
  last_size_ = text.size();
  file_.replaceEnd(last_begin_, text + "\n ]\n}\n");
  changed_ = false;
}

}  // namespace dsorb::io
